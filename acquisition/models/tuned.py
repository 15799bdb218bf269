"""Tuned numbers: fields of a method's frozen settings, each with its unit; meaning and source are in its docstring."""

from dataclasses import field
from typing import Any, TypeVar

NumberT = TypeVar("NumberT")
UNIT = "unit"


def tuned(value: NumberT, unit: str) -> NumberT:
    """Declares the default of a dataclass field that was chosen by measurement or judgement. Ratios have the unit `1`.

    The first sentence of the field's docstring says what the number is, the others where its value comes from. The page
    `docs/reference/tuned-numbers.md` lists all fields, and how the error changes when they are halved or doubled.
    """
    declared: Any = field(default=value, metadata={UNIT: unit})
    return declared
