"""Light positions, and the plan of one pass with its forecast and its certificate."""

from pydantic import Field

from acquisition.models.base import Value, Vector3


class Light(Value):
    """A lamp's place: the emitter in m and the unit vector along which the lamp looks, both in the view frame."""

    position: Vector3
    axis: Vector3


class ForecastPoint(Value):
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
    forecast: list[ForecastPoint] = Field(
        default_factory=list[ForecastPoint],
        description="Error to be expected against number of lights; empty: not asked",
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
