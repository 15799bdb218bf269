"""Jogging: the motion of the arm while a person holds a button."""

from typing import Literal

from pydantic import Field, model_validator

from acquisition.models.base import Value

MAX_STEP_RAD, MAX_STEP_M = 0.1, 0.03
"""Longest certified step of a joint, rad, and of the lamp along an axis, m."""


class JogMotion(Value):
    """One joint, or one axis of the base frame, and the direction of the motion."""

    joint: int | None = Field(default=None, ge=0, le=5, description="Joint to be turned, 0: the base; or give `axis`")
    axis: Literal["x", "y", "z"] | None = Field(
        default=None, description="Axis of the base frame along which the tool is moved, its orientation kept"
    )
    direction: Literal[-1, 1] = Field(description="Towards smaller or larger values")
    step_rad: float = Field(
        default=MAX_STEP_RAD,
        gt=0,
        le=MAX_STEP_RAD,
        description="Longest step of a joint that is certified at once, rad",
    )
    step_m: float = Field(
        default=MAX_STEP_M, gt=0, le=MAX_STEP_M, description="Longest step along an axis that is certified at once, m"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "JogMotion":
        if (self.joint is None) == (self.axis is None):
            raise ValueError("give either joint or axis")
        return self
