"""Rounded figures for people, of which a small one is not shown as 0."""

from itertools import count

LEAST_PERCENT = 0.001
"""Least size, percent, that is written out; of a smaller one the text says only that it is smaller."""


def percent(share: float, decimals: int = 1, *, signed: bool = False) -> str:
    """Returns a share in percent, without the sign %: with `decimals` decimals or, where that gives 0, with as many as
    show its first digit. `signed` puts a plus before a positive one."""
    value, sign = 100 * share, "+" if signed else ""
    if value == 0:
        return "0"
    if abs(value) < LEAST_PERCENT:
        return f"under {'±' if signed else ''}{LEAST_PERCENT:g}"
    return next(text for digits in count(decimals) if float(text := f"{value:{sign}.{digits}f}") != 0)
