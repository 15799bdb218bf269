"""Results of a solve: the normal map with its uncertainty, its summary, and the settings that made it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from acquisition.models.base import BoolArray, Float32Array, FloatArray, Value

LIT, ATTACHED, CAST, SATURATED, HIGHLIGHT = 1, 2, 4, 8, 16
"""Bits of NormalMap.flags, per light and pixel."""


@dataclass(frozen=True)
class FisherInformation:
    """Fisher information of K sample pixels, from which the planner's criterion starts.

    `matrices` is the information of (g, z), where g is albedo × normal (3) in units of absolute albedo and z the depth
    in m. It comes from the images alone, without a prior, with the weights that the solver used.
    """

    rows: npt.NDArray[np.int64]  # (K,)
    columns: npt.NDArray[np.int64]  # (K,)
    matrices: FloatArray  # (K, 4, 4)


class ModelFinding(Value):
    """Something about the capture that the plain model of the images does not contain."""

    kind: str = Field(description="rough surface, ambient light, coded values, bad image, swapped lamps, …")
    message: str = Field(description="What was found and what was done about it, one sentence")
    corrected: bool = Field(description="Whether the solve takes it into account; else σ may be too small")
    value: float | None = Field(
        default=None, description="Estimated amount, by kind: rad, share of white, exponent, image"
    )


class GoodnessOfFit(Value):
    """Goodness of fit of the images to the model, relative to the noise that sensor and calibration state.

    A misfit is the robust rms of studentised residuals. Its probability is that of a sound capture fitting as badly.
    """

    misfit: float = Field(description="Rms of studentised residuals of all images; 1: as the stated noise predicts")
    probability: float = Field(description="Probability that a sound capture fits as badly, 0 to 1")
    image_misfits: list[float | None] = Field(description="Of each image; none: too few measurements")
    image_probabilities: list[float | None] = Field(description="Of each image, 0 to 1; null: too few measurements")
    region_misfits: list[list[float | None]] = Field(
        description="Of a grid of regions over the object's bounding box, rows from the top"
    )


MEAN_ERROR_PER_SIGMA, MEDIAN_ERROR_PER_SIGMA = 0.886, 0.833
"""Mean and median of the angular error in units of σ: √π/2 and √ln 2. They hold if both tangential errors are Gaussian
with the same variance (Rayleigh distribution)."""


@dataclass(frozen=True)
class NormalMap:
    """Per-pixel result of a solve. Arrays are zero (σ: NaN) outside `mask`.

    `sigma_deg` is the square root of the variance summed over both tangential directions. The angular error then has a
    Rayleigh distribution with mean 0.886 σ, median 0.833 σ and P(e < σ) = 0.632. σ is unreliable where `doubtful` is
    true: fewer than three lights, hardly any lamp that reaches the pixel, or more `indirect` than direct light.
    """

    normals: Float32Array  # (H, W, 3) view frame
    albedo: Float32Array  # (H, W) absolute
    depth: Float32Array  # (H, W) m along OpenCV's z
    sigma_deg: Float32Array  # (H, W)
    residual: Float32Array  # (H, W) rms of whitened residuals
    mask: BoolArray  # (H, W) pixels with a normal
    silhouette: BoolArray  # (H, W) pixels of the object, solved or not
    flags: npt.NDArray[np.uint8]  # (F, H, W)
    intensity_factors: FloatArray  # (F,)
    information: FisherInformation
    doubtful: BoolArray  # (H, W)
    indirect: Float32Array | None = None  # (H, W) share of indirect in all light; none: not predicted
    albedo_rgb: Float32Array | None = None  # (H, W, 3) of each channel; none: grey images
    noise: dict[str, float] = field(default_factory=dict[str, float])  # names of parameters → values used
    notes: dict[str, Any] = field(default_factory=dict[str, Any])
    fit: GoodnessOfFit | None = None  # none: not evaluated
    findings: tuple[ModelFinding, ...] = ()  # what the plain model of the images does not contain


class ResultSummary(Value):
    """The figures of one result that a person reads first."""

    images: int = Field(description="Number of images that were solved")
    object_pixels: int = Field(description="Pixels of the object's silhouette")
    solved_pixels: int = Field(description="Pixels with a normal")
    mean_sigma_deg: float = Field(
        description="Mean angular σ, degrees, over the solved pixels inside the silhouette that are seen no more than "
        "78° from their normal"
    )
    median_sigma_deg: float = Field(description="Median over the same pixels of the angular σ, degrees")
    region_sigma_deg: float | None = Field(
        default=None, description="Mean over those of these pixels in the region of interest; none: no region is drawn"
    )
    predicted_sigma_deg: float | None = Field(
        description="Mean angular σ that the plan expected, degrees; null: no prediction"
    )
    predicted_median_deg: float | None = Field(
        description="Median angular error that the plan expected, degrees; null: no prediction"
    )
    fewer_than_three_lights: float = Field(
        description="Share of the object's pixels, solved or not, that fewer than three lights reach, 0 to 1"
    )
    intensity_factors: list[float] = Field(
        description="For each image, the estimated factor on the lamp's intensity, about 1"
    )
    noise: dict[str, float] = Field(
        description="Estimated noise by kind, in fractions of full scale (`read`) or of the signal (`intensity`)"
    )
    fit: GoodnessOfFit | None = Field(default=None, description="None: results of releases up to 0.1, or not evaluated")
    findings: list[ModelFinding] = Field(
        default=[], description="What the plain model of the images does not contain, corrected or not"
    )


class SolveSettings(Value):
    """Settings of a solve."""

    depth_rounds: int = Field(
        default=2, ge=0, le=10, description="Times that depth is integrated and the solve repeated"
    )
    shadow_threshold: float = Field(
        default=0.08,
        ge=0,
        lt=0.5,
        description="Share of the pixel's largest normalised value below which a value counts as shadow",
    )
    robust: bool = Field(default=True, description="Reweight residuals, so that shadows and highlights count less")
    keep_steps: bool = Field(
        default=False,
        description="Let depth jump where normals disagree with their neighbours; elsewhere depth is slightly less "
        "accurate",
    )
