"""Rounded figures for people, of which a small one is not shown as 0."""

from itertools import count

LEAST = 0.001
"""Least size, in whatever unit, that is written out; of a smaller one the text says only that it is smaller."""


def percent(share: float, decimals: int = 1, *, signed: bool = False) -> str:
    """Returns a share in percent as `figure` does, with the sign % after a space."""
    return f"{figure(100 * share, decimals, signed=signed)} %"


def figure(value: float, decimals: int, *, signed: bool = False) -> str:
    """Returns a value with `decimals` decimals or, where that gives 0, with as many as show its first digit.

    `signed` puts a plus before a positive one.
    """
    sign = "+" if signed else ""
    if value == 0:
        return "0"
    if abs(value) < LEAST:
        return f"under {'±' if signed else ''}{LEAST:g}"
    return next(text for digits in count(decimals) if float(text := f"{value:{sign}.{digits}f}") != 0)
