"""Joint paths, waypoints and routes, and what the stages that choose lights see of the arm's reach."""

from typing import Literal, Protocol

from pydantic import Field

from acquisition.models.base import FloatArray, Joints, Value
from acquisition.models.light_plan import Light


class Waypoint(Value):
    """Where one light is taken: a checked joint path that ends at the place of exposure, and the light it gives."""

    light: Light
    path: list[Joints] = Field(min_length=1)
    speeds: list[float] = Field(description="For each item of `path`, rad/s of the leading joint on the way to it")
    seconds: float

    @property
    def joints(self) -> tuple[float, ...]:
        """The joints at exposure, rad."""
        return self.path[-1]


class JointPath(Value):
    """Checked straight joint segments: where each ends, and the leading joint's speed on it in rad/s."""

    path: list[Joints]
    speeds: list[float]
    seconds: float


class Route(Value):
    """Waypoints in the order of travel, and the checked way home after the last one."""

    start: Joints
    waypoints: list[Waypoint]
    light_numbers: list[int] = Field(description="For each waypoint, the light's number in the plan")
    home_path: list[Joints]
    home_speeds: list[float] = Field(description="For each item of `home_path`, rad/s of the leading joint")
    seconds: float = Field(description="Time of all moves, without settling and exposing")
    lower_bound_s: float


class Refusal(Value):
    """Why a light cannot be had: a word for programs and a sentence for people."""

    reason: Literal[
        "too-far", "joint-limit", "self-collision", "hits-table", "hits-object", "hits-camera", "hits-obstacle",
        "blocks-view", "shadows-object", "not-connected",
    ]  # fmt: skip
    detail: str


class Reach(Protocol):
    """Which light positions the arm can serve; the stages that choose lights see no more of the arm than this."""

    @property
    def candidates(self) -> FloatArray:
        """Reachable positions (K, 3), m, view frame."""
        ...

    @property
    def center(self) -> FloatArray:
        """The point (3,) at which the lamp looks, m, view frame; the dome's centre."""
        ...

    @property
    def radius_m(self) -> float:
        """The dome's radius."""
        ...

    def allows(self, position: FloatArray) -> Refusal | None:
        """None when the lamp can be brought to `position` (3,) and back home, else the reason."""
        ...
