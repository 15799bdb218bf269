"""Forecast for lights that a person places: the gain of each, whether the arm can reach it, and the expected σ."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from acquisition.models.base import Value, Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.recipe import Recipe
from acquisition.models.route import Refusal
from acquisition.models.shot import Observations


@dataclass(frozen=True)
class ForecastInput:
    """Input of the forecasts of one review. `result` is the folder of the last result, None before the first."""

    recipe: Recipe
    cell: CellConfig
    calibration: Calibration
    result: Path | None
    observations: Observations
    region_file: Path | None


class PlacedLight(Value):
    """One light that a person has placed."""

    position: Vector3 = Field(description="Position of the emitter as it was given; m, view frame")
    refusal: Refusal | None = Field(description="Why the arm cannot serve it; null: it can, and gets home from there")
    gain: float | None = Field(
        description="Fraction by which the mean σ would rise without this light, the other served ones given (as in a "
        "plan's `gains`); null for a light that is not served, or without an earlier result"
    )


class LightForecast(Value):
    """Expected σ with the placed lights. Lights that the arm cannot reach are left out of all figures."""

    lights: list[PlacedLight] = Field(description="The lights in the order in which they were given")
    sigma_before_deg: float | None = Field(
        description="Mean over the object's pixels (or the region of interest) of the expected angular σ without these "
        "lights, degrees; null without an earlier result"
    )
    sigma_deg: float | None = Field(
        description="The same with these lights: for a plan's own lights its `predicted_sigma_deg`; degrees"
    )
    median_deg: float | None = Field(
        description="Expected median angular error with these lights, 0.833 × median σ, degrees"
    )
    brightest_sigma_deg: float | None = Field(
        description="σ that the picture shows brightest, degrees: a percentile of σ without these lights, so that "
        "pictures of one review can be compared; a hundredth of it is black, and the scale between is logarithmic"
    )
