"""Array types, fixed-size tuples and the base class of all values that cross HTTP or disk.

Whatever crosses HTTP or disk is a frozen pydantic model that refuses unknown fields, NaN and infinity; whatever holds
images or dense arrays is a frozen dataclass. Positions and directions are in the `view` frame (origin at the camera, x
right, y up, z to the camera) unless a name says otherwise. Lengths are in m, angles in rad, times in s.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

FloatT = TypeVar("FloatT", np.float32, np.float64)
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
# JSON has lists only; these three are lists there and tuples here.
Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
Joints = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]
Matrix4 = Annotated[
    tuple[
        Annotated[tuple[float, float, float, float], Field(strict=False)],
        Annotated[tuple[float, float, float, float], Field(strict=False)],
        Annotated[tuple[float, float, float, float], Field(strict=False)],
        Annotated[tuple[float, float, float, float], Field(strict=False)],
    ],
    Field(strict=False),
]


def as_joints(values: Sequence[float]) -> tuple[float, float, float, float, float, float]:
    """Returns six joint angles as a tuple, the type of fields of `Joints`."""
    one, two, three, four, five, six = (float(value) for value in values)
    return (one, two, three, four, five, six)


def as_matrix4(matrix: FloatArray) -> Matrix4:
    """Returns a (4, 4) pose as a tuple of rows, the type of fields of `Matrix4`."""
    rows = [tuple(float(value) for value in row) for row in matrix]
    return cast(Matrix4, tuple(rows))


def wrong_fields(error: ValidationError) -> str:
    """Names each wrong field and what is wrong with it, in one line without pydantic's headings and links."""
    return "; ".join(": ".join(filter(None, (_path(item["loc"]), _what(item)))) for item in error.errors())


def _path(parts: tuple[int | str, ...]) -> str:
    return ".".join(map(str, parts))


def _what(item: "ErrorDetails") -> str:
    if item["type"] != "union_tag_invalid":
        return item["msg"]
    tag, expected = (item.get("ctx", {}).get(name) for name in ("tag", "expected_tags"))
    return f"there is no kind {tag!r}: choose one of {expected}"


class Value(BaseModel):
    """Base of all values that cross HTTP or disk: frozen, strict, no unknown fields, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, ser_json_inf_nan="null")
