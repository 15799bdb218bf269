"""Estimate of the time that a session will still take, and the source of the estimate."""

from typing import Literal

from pydantic import Field

from acquisition.models.base import Value

Basis = Literal["this-session", "earlier-sessions", "route", "assumed"]
"""Source of a time: measured in this session; measured in completed sessions of this cell; the route's computed moving
time with assumed stops; a constant of the software."""


class TimePart(Value):
    """Remaining work of one kind."""

    work: Literal["pilot", "plan", "waypoints", "images", "normals", "estimate"] = Field(
        description="Choosing the first lights, planning further ones, computing the route, capturing images (moves "
        "included), solving; of a calibration its estimate"
    )
    count: int = Field(ge=1, description="How many of them are left")
    seconds: float = Field(ge=0, description="Time for all of them, s")
    rests_on: Basis = Field(description="Where the time of one of them was taken from")


class TimeLeft(Value):
    """Estimated time until the session ends, without the time of people for reviews or after an interruption."""

    seconds: float = Field(ge=0, description="Sum of the parts, less what the step in progress has taken so far, s")
    at_least: bool = Field(
        description="Whether more may follow: with an ordered accuracy the number of lights is not known in advance"
    )
    parts: list[TimePart] = Field(description="What is left, in the order of the stages")
