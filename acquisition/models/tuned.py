"""Tuned numbers: fields of a method's frozen settings, each with its unit; meaning and source are in its docstring."""

from dataclasses import field
from typing import Any, TypeVar

NumberT = TypeVar("NumberT")
UNIT = "unit"


def tuned(value: NumberT, unit: str) -> NumberT:
    """The default of a dataclass's field that was chosen by measurement or judgement; `1` is the unit of ratios.

    The field's docstring says in its first sentence what it is, in the others where the value comes from. The page
    `docs/reference/tuned-numbers.md` lists all fields with how the error moves when they are halved or doubled.
    """
    declared: Any = field(default=value, metadata={UNIT: unit})
    return declared
