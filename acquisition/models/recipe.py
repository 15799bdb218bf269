"""The recipe: the user's parameters of one capture session."""

from typing import Any, Literal, cast

from pydantic import Field, model_validator

from acquisition.models.base import Value, Vector3

Method = Literal["optimal", "two-rings", "ring", "drbohlav", "max-distance", "paper", "random", "user"]
ExposurePlan = Literal["fixed", "planned"]
"""One automatic exposure of each light; or planned exposures, several of one light merged by inverse variances."""

UNPLANNED_FACTOR = 8.0
"""Ratio of a light's second exposure time to its automatic one while its exposures are not planned, as in a pilot."""

FORMER_OBJECTIVES = ("capped", "mean", "quantile", "coverage")
"""Values of `objective` in recipes of release 0.1."""


class Exposure(Value):
    """Automatic exposure: sets the 99.5th percentile of the object's pixels to the fraction `target` of full scale."""

    plan: ExposurePlan = Field(
        default="fixed",
        description="`fixed`: one automatic exposure of each light; `planned`: exposure times and numbers of frames of "
        "each light are chosen with the plan, for the least expected loss in a given time, and merged by their noise",
    )
    target: float = Field(
        default=0.8,
        gt=0.05,
        le=0.95,
        description="Fraction of full scale that the brightest pixels reach, above 0.05, up to 0.95",
    )
    seconds: float | None = Field(
        default=None, gt=0, le=10, description="A fixed exposure time for all lights; none: automatic"
    )
    max_frames_per_light: int = Field(
        default=6,
        ge=1,
        le=32,
        description="With `planned`: most frames of one light, of all its exposure times together",
    )
    seconds_per_light: float = Field(
        default=2.0, gt=0, le=60, description="With `planned`: most exposure time of one light, all its frames, s"
    )

    @model_validator(mode="after")
    def _fixed_time_is_not_planned(self) -> "Exposure":
        if self.plan == "planned" and self.seconds is not None:
            raise ValueError(
                "give `seconds` or plan `planned`, not both: a fixed exposure time leaves nothing to be planned"
            )
        return self


class Capture(Value):
    """How images are taken."""

    while_moving: bool = Field(
        default=False,
        description="Whether images are taken as the arm arrives at each light and leaves it, with the lamp on all the "
        "way: an exposure begins as soon as the lamp will move by less than its calibrated 1 σ until it ends; images "
        "during which it moved further are taken again at rest",
    )


class Recipe(Value):
    """Parameters of a capture session. The defaults, `{}`, are a complete recipe."""

    kind: Literal["capture"] = Field(default="capture", description="Kind of recipe; there is one")
    method: Method = Field(
        default="optimal",
        description="How lights are chosen: `optimal` by experimental design from the pilot; the others are patterns",
    )
    pilot_lights: int = Field(default=4, ge=3, le=16, description="Number of lights of the pilot")
    planned_lights: int = Field(
        default=4, ge=0, le=64, description="0: the pilot only, or as many as `target_sigma_deg` requires"
    )
    target_sigma_deg: float | None = Field(
        default=None,
        ge=0.1,
        le=10,
        description="Target accuracy: lights are added until the mean σ over the object, or over the region of "
        "interest, is at most 3 % above this value (mean error 0.886 σ); instead of planned_lights",
    )
    max_lights: int = Field(
        default=24, ge=3, le=80, description="Maximum number of lights for a target, pilot included"
    )
    slant_deg: float = Field(default=45.0, ge=5, le=80, description="Slant of method `ring`")
    user_lights: list[Vector3] = Field(
        default_factory=list[tuple[float, float, float]],
        max_length=80,
        description="Positions of method `user`: m, view frame (origin camera, x right, y up, z to the camera)",
    )
    seed: int = Field(
        default=0, ge=0, le=2**31 - 1, description="Seed of everything random: the same images give the same plan"
    )
    exposure: Exposure = Field(default=Exposure(), description="Exposure of the images")
    capture: Capture = Field(default=Capture(), description="How images are taken")
    retakes: int = Field(default=2, ge=0, le=10, description="How often a rejected image is taken again")
    review_plan: bool = Field(
        default=False, description="Pause after planning, so that a person can review and change the lights"
    )
    label: str = Field(default="", max_length=200, description="Title for people, up to 200 characters")
    notes: str = Field(default="", max_length=10_000, description="Notes for people, up to 10,000 characters")

    @model_validator(mode="before")
    @classmethod
    def _objective_of_release_0_1_is_left_out(cls, given: Any) -> Any:
        """Ignores `objective` in recipes of release 0.1, since there is only one objective."""
        if isinstance(given, dict) and cast(dict[str, Any], given).get("objective") in FORMER_OBJECTIVES:
            return {name: value for name, value in cast(dict[str, Any], given).items() if name != "objective"}
        return given

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
            raise ValueError(
                "give planned_lights or target_sigma_deg, not both: a target chooses the number of lights itself"
            )
        if self.method != "optimal":
            raise ValueError("target_sigma_deg is for method `optimal`: a fixed pattern has a fixed number of lights")
        if self.max_lights < self.pilot_lights:
            raise ValueError("max_lights counts the pilot's lights too: it must not be below pilot_lights")
        return self

    @model_validator(mode="after")
    def _several_exposures_are_taken_at_rest(self) -> "Recipe":
        if self.exposure.plan == "planned" and self.capture.while_moving:
            raise ValueError(
                "give exposure.plan `planned` or capture.while_moving, not both: several exposures of a light need a "
                "lamp at rest"
            )
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
        """Total number of lights of the session; with a target, the maximum."""
        if self.method == "user":
            return len(self.user_lights)
        return self.pilot_lights + self.planned_lights if self.target_sigma_deg is None else self.max_lights
