"""Light positions, and the plan of one pass with its forecast and its certificate."""

from pydantic import Field

from acquisition.models.base import Joints, Value, Vector3


class Light(Value):
    """Pose of the lamp: emitter position in m and unit vector of the lamp's optical axis, both in the view frame."""

    position: Vector3 = Field(description="Position of the emitter: m, view frame")
    axis: Vector3 = Field(description="Direction of the beam: unit vector, view frame")
    tilt: Vector3 | None = Field(
        default=None,
        description="Vector across the axis, view frame: in a unit direction d the intensity is 1 + tilt · d times as "
        "much; none: not known, or no tilt",
    )


class FrameExposure(Value):
    """One or more frames of one light with the same exposure time."""

    exposure_s: float = Field(gt=0, description="Exposure time of each, s")
    frames: int = Field(default=1, ge=1, description="How many of them; they are averaged")


class LightExposure(Value):
    """The exposures of one light, which are merged into one image with inverse-variance weights."""

    frames: list[FrameExposure] = Field(
        min_length=1, description="The first is the one that the image is judged by; others are longer or shorter"
    )
    seconds: float = Field(ge=0, description="Time that the light's frames take, without moving there, s")
    gain: float = Field(
        description="Fraction by which the mean σ would rise if this light had one automatic exposure instead"
    )

    @property
    def times_s(self) -> list[float]:
        """The exposure time of each frame, in the order in which they are taken, s."""
        return [one.exposure_s for one in self.frames for _ in range(one.frames)]


class ForecastPoint(Value):
    """One point of the forecast: the expected σ after a number of lights."""

    added: int = Field(ge=0, description="Lights planned in addition to those captured so far")
    lights: int = Field(ge=0, description="Total number of lights of the session then")
    sigma_deg: float = Field(description="Mean over the object's pixels of the expected angular σ (mean error 0.886 σ)")


class PriorForecast(Value):
    """Forecast before the first image: the expected σ of an assumed object against the number of images."""

    points: list[ForecastPoint] = Field(description="Ascending number of images; the recipe's own number is among them")
    assumption: str = Field(description="What object is assumed, one or two sentences")


class LightPlan(Value):
    """The lights of one pass, with predicted accuracy and certificate."""

    lights: list[Light] = Field(description="The lights of the pass")
    method: str = Field(description="How they were chosen: a recipe's `method`")
    reasons: list[str] = Field(description="For each light, why it was chosen")
    joints: list[Joints] | None = Field(
        default=None,
        description="With the calibration board on the flange: each pose's joints, rad; `lights` are then the poses "
        "that the lamp has, or would have. Null: lights alone were chosen",
    )
    predicted_sigma_deg: float | None = Field(
        default=None,
        description="Mean over the object's pixels of the expected angular σ after this pass (mean error 0.886 σ)",
    )
    predicted_median_deg: float | None = Field(
        default=None, description="Expected median angular error, 0.833 × median σ"
    )
    lower_bound_sigma_deg: float | None = Field(
        default=None,
        description="Lower bound of the mean posterior σ over all designs of the candidates, given the predicted "
        "shadows; comparable with efficiencies, not with predicted_sigma_deg, which has the model's errors too",
    )
    efficiency: float | None = Field(
        default=None, description="Efficiency of the plan: lower bound over its own mean posterior σ; 1 is optimal"
    )
    two_rings_efficiency: float | None = Field(default=None, description="Efficiency of as many lights on two rings")
    relaxation_gap: float | None = Field(
        default=None, description="Relative gap at which the optimisation of the lower bound ended"
    )
    certificate_note: str | None = Field(default=None, description="Interpretation of the lower bound for this plan")
    forecast: list[ForecastPoint] = Field(
        default_factory=list[ForecastPoint],
        description="Expected σ as a function of the number of lights; empty: not requested",
    )
    fallback: str | None = Field(
        default=None,
        description="In plans of release 0.1, why two rings replaced the planned lights; null in all later plans",
        json_schema_extra={"deprecated": True},
    )
    gains: list[float] = Field(
        default_factory=list[float],
        description="For each light, the fraction by which the mean σ would rise without it; empty: no prediction",
    )
    brightest_gain_deg: float | None = Field(
        default=None, description="Gain in σ that the lights' gain images show brightest; none: no images"
    )
    levels_per_s: list[float] | None = Field(
        default=None,
        description="For each light, the expected 99.5th percentile of the object's signal as a fraction of full scale "
        "per second; none: the object is not known yet",
    )
    exposures: list[LightExposure] | None = Field(
        default=None,
        description="For each light, its planned exposures with their time and gain; none: one automatic exposure each",
    )
    notes: list[str] = Field(
        default_factory=list[str], description="Notes for the user, such as lights left out and why"
    )
    conclusion: str | None = Field(
        default=None, description="Why no further lights are captured for the recipe's target; none: there are some"
    )
