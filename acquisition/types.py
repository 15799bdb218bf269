"""The values that the stages hand to one another.

Whatever crosses HTTP or disk is a frozen pydantic model that refuses unknown fields, NaN and infinity; whatever holds
images or dense arrays is a frozen dataclass. Positions and directions are in the `view` frame (origin at the camera, x
right, y up, z to the camera) unless a name says otherwise; lengths m, angles rad, times s.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Protocol, cast

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, model_validator

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
    """Six joint angles as the tuple that values hold."""
    one, two, three, four, five, six = (float(value) for value in values)
    return (one, two, three, four, five, six)


def as_matrix4(matrix: FloatArray) -> Matrix4:
    """A (4, 4) pose as the tuple that values hold."""
    rows = [tuple(float(value) for value in row) for row in matrix]
    return cast(Matrix4, tuple(rows))


class Value(BaseModel):
    """Base of all values that cross HTTP or disk: frozen, strict, no unknown fields, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, ser_json_inf_nan="null")


# ---------------------------------------------------------------------------------------------------- what is asked for

Method = Literal["optimal", "two-rings", "ring", "drbohlav", "max-distance", "paper", "random", "user"]

Objective = Literal["capped", "mean", "quantile", "coverage"]
"""Over the object's pixels, or over the region of interest: `capped` the mean of the angular variance, each pixel's
capped so that a few that no light can reach do not decide for all; `mean` the mean σ; `quantile` the σ that nine tenths
of the pixels keep below; `coverage` first as many pixels as can be lit by three lights, then `capped`."""


class Exposure(Value):
    """How exposure times are chosen: the 99.5th percentile of the object's pixels is put at `target` of full scale."""

    target: float = Field(default=0.8, gt=0.05, le=0.95)
    seconds: float | None = Field(
        default=None, gt=0, le=10, description="A fixed exposure time for all lights; none: automatic"
    )


class Recipe(Value):
    """What a person asks of a session; `{}` is a good session."""

    kind: Literal["capture"] = "capture"
    method: Method = "optimal"
    pilot_lights: int = Field(default=4, ge=3, le=16)
    planned_lights: int = Field(
        default=4, ge=0, le=64, description="0: the pilot only, or as many as `target_sigma_deg` needs"
    )
    target_sigma_deg: float | None = Field(
        default=None,
        ge=0.1,
        le=10,
        description="Accuracy on order: lights are added until the mean σ over the object, or over the region of "
        "interest, is no more than this or 3 % above (mean error 0.886 σ; what bends within pixels leave counts too); "
        "instead of planned_lights",
    )
    max_lights: int = Field(default=24, ge=3, le=80, description="The most lights, pilot included, for a target")
    objective: Objective = Field(default="capped", description="What method `optimal` makes as small as it can")
    slant_deg: float = Field(default=45.0, ge=5, le=80, description="Slant of method `ring`")
    user_lights: list[Vector3] = Field(
        default_factory=list[tuple[float, float, float]],
        max_length=80,
        description="Positions of method `user`: m, view frame (origin camera, x right, y up, z to the camera)",
    )
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    exposure: Exposure = Exposure()
    retakes: int = Field(default=2, ge=0, le=10)
    review_plan: bool = Field(
        default=False, description="Pause when lights are planned, so that a person can look and change them"
    )
    label: str = Field(default="", max_length=200)
    notes: str = Field(default="", max_length=10_000)

    @model_validator(mode="before")
    @classmethod
    def _a_target_takes_the_place_of_a_number(cls, given: Any) -> Any:
        if isinstance(given, dict) and cast(dict[str, Any], given).get("target_sigma_deg") is not None:
            return {"planned_lights": 0, **cast(dict[str, Any], given)}
        return given

    @model_validator(mode="after")
    def _target_is_for_planned_lights(self) -> "Recipe":
        if self.target_sigma_deg is None:
            return self
        if self.planned_lights:
            raise ValueError("give planned_lights or target_sigma_deg: a target chooses the number of lights itself")
        if self.method != "optimal":
            raise ValueError("target_sigma_deg is for method `optimal`: a fixed pattern has a fixed number of lights")
        if self.max_lights < self.pilot_lights:
            raise ValueError("max_lights counts the pilot's lights too: it must not be below pilot_lights")
        return self

    @model_validator(mode="after")
    def _user_lights_belong_to_method_user(self) -> "Recipe":
        if self.method == "user" and len(self.user_lights) < 3:
            raise ValueError("method `user` needs at least three user_lights")
        if self.method != "user" and self.user_lights:
            raise ValueError("user_lights are for method `user` only")
        return self

    @property
    def lights_total(self) -> int:
        """How many lights the whole session uses; with a target, how many at most."""
        if self.method == "user":
            return len(self.user_lights)
        return self.pilot_lights + self.planned_lights if self.target_sigma_deg is None else self.max_lights


# ----------------------------------------------------------------------------------------------------- light and motion


class Light(Value):
    """A lamp's place: the emitter in m and the unit vector along which the lamp looks, both in the view frame."""

    position: Vector3
    axis: Vector3


class Expected(Value):
    """One point of the forecast curve: the error to be expected after so many lights."""

    added: int = Field(ge=0, description="Lights planned beside those taken already")
    lights: int = Field(ge=0, description="All lights of the session then")
    sigma_deg: float = Field(description="Mean over the object's pixels of the expected σ (mean error 0.886 σ)")


class LightPlan(Value):
    """The lights of one pass and what is expected of them."""

    lights: list[Light]
    method: str
    reasons: list[str] = Field(description="For each light, why it is there")
    predicted_sigma_deg: float | None = Field(
        default=None,
        description="Mean over the object's pixels of the expected angular σ after this pass (mean error 0.886 σ)",
    )
    predicted_median_deg: float | None = Field(
        default=None, description="Expected median angular error, 0.833 × median σ"
    )
    lower_bound_sigma_deg: float | None = Field(
        default=None,
        description="Root of the mean angular variance that no choice among the candidates can go below, as far as "
        "shadows are known; comparable with efficiencies, not with the mean of σ",
    )
    efficiency: float | None = Field(
        default=None, description="Lower bound over the plan's own root mean variance: 1 is the best there can be"
    )
    two_rings_efficiency: float | None = Field(default=None, description="The same of as many lights on two rings")
    relaxation_gap: float | None = Field(
        default=None, description="How far the bound's own optimisation was from its end, as a fraction"
    )
    certificate_note: str | None = Field(default=None, description="What the bound says of this plan, in words")
    forecast: list[Expected] = Field(
        default_factory=list[Expected], description="Error to be expected against number of lights; empty: not asked"
    )
    fallback: str | None = Field(
        default=None, description="Why the two-ring pattern was taken in place of planned lights; none: it was not"
    )
    gains: list[float] = Field(
        default_factory=list[float],
        description="For each light, the share by which the mean σ would rise without it; empty: nothing is predicted",
    )
    brightest_gain_deg: float | None = Field(
        default=None, description="Gain in σ at a pixel that the lights' pictures show brightest; none: no pictures"
    )
    levels_per_s: list[float] | None = Field(
        default=None,
        description="For each light, the expected 99.5th percentile of the object's signal as a fraction of full scale "
        "per second; none: nothing is known of the object yet",
    )
    notes: list[str] = Field(default_factory=list[str], description="What a person should know: lights left out, why")
    conclusion: str | None = Field(
        default=None, description="Why no further lights are taken for the recipe's target; none: there are some"
    )


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
