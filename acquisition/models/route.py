"""Joint paths, waypoints and routes, and the interface of the arm's reach for the stages that choose lights."""

from typing import Literal, Protocol

from pydantic import Field

from acquisition.models.base import FloatArray, Joints, Value
from acquisition.models.light_plan import Light


class Waypoint(Value):
    """Waypoint of one light: a certified joint path that ends at the configuration of exposure, and the light there."""

    light: Light = Field(description="The lamp's pose at exposure")
    path: list[Joints] = Field(
        min_length=1,
        description="Joint angles at the end of each straight segment, rad; the last is the configuration of exposure",
    )
    speeds: list[float] = Field(description="Leading joint's speed in rad/s on the segment to each item of `path`")
    seconds: float = Field(description="Duration of the moves, s")

    @property
    def joints(self) -> tuple[float, ...]:
        """The joints at exposure, rad."""
        return self.path[-1]


class JointPath(Value):
    """Certified straight joint segments: the end of each in rad, and the leading joint's speed on it in rad/s."""

    path: list[Joints]
    speeds: list[float]
    seconds: float


class Route(Value):
    """Waypoints in the order of travel, and the certified path home after the last one."""

    start: Joints = Field(description="Joint angles at the start, rad")
    waypoints: list[Waypoint] = Field(description="The lights in the order of travel")
    light_numbers: list[int] = Field(description="Number of each waypoint's light in the plan")
    home_path: list[Joints] = Field(
        description="Certified path home after the last light: joint angles at the end of each segment, rad"
    )
    home_speeds: list[float] = Field(
        description="Leading joint's speed in rad/s on the segment to each item of `home_path`"
    )
    seconds: float = Field(description="Duration of all moves in s, without settling and exposure")
    lower_bound_s: float = Field(description="Lower bound of the duration over all orders of the lights, s")


class Refusal(Value):
    """Why a light is unreachable: a reason code for programs and a sentence for people."""

    reason: Literal[
        "too-far", "joint-limit", "self-collision", "hits-table", "hits-object", "hits-camera", "hits-obstacle",
        "blocks-view", "shadows-object", "not-connected",
    ] = Field(description="For programs")  # fmt: skip
    detail: str = Field(description="For people, one sentence")

    def of_light(self, number: int) -> dict[str, int | str]:
        """Returns the refusal of a plan's light as an item of a problem's `lights`."""
        return {"number": number, "reason": self.reason, "detail": self.detail}


class Reach(Protocol):
    """Light positions to choose from. The stages that choose lights know the arm only by this interface."""

    @property
    def candidates(self) -> FloatArray:
        """Reachable positions (K, 3), m, view frame."""
        ...

    @property
    def center(self) -> FloatArray:
        """The dome's centre (3,), m, view frame, towards which the lamp's axis points."""
        ...


class ArmReach(Reach, Protocol):
    """The reach of an arm, which can also judge positions other than the candidates."""

    def allows(self, position: FloatArray) -> Refusal | None:
        """Returns None if the lamp can be moved to `position` (3,) and back home, else the refusal."""
        ...
