"""Lists in sentences for people, of which the first few items are named and the others counted."""

from collections.abc import Sequence

NAMED = 5
"""Number of items that a sentence names."""


def first_few(items: Sequence[str], separator: str = ", ", rest: str = "") -> str:
    """Returns all items if they are at most `NAMED`, and else the first ones and the number of the others; `rest` says
    where these are listed."""
    if len(items) <= NAMED:
        return separator.join(items)
    return separator.join([*items[:NAMED], f"and {len(items) - NAMED} more{rest}"])


def refused_lights(sentences: Sequence[str]) -> str:
    """Returns one sentence on refused lights from one for each; a problem lists all of them in its field `lights`."""
    many = f"{len(sentences)} lights are refused: " if len(sentences) > NAMED else ""
    return many + first_few(sentences, "; ", " (all in `lights`)")
