"""The recipe: what a person asks of one capture session."""

from typing import Any, Literal, cast

from pydantic import Field, model_validator

from acquisition.models.base import Value, Vector3

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
        "interest, is no more than this or 3 % above (mean error 0.886 σ; includes the error by sub-pixel curvature); "
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
