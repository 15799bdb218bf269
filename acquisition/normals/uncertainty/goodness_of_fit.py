"""Goodness of fit: studentised residuals against the noise that sensor and calibration state, never the fitted one.

The noise components that the solve fits to its own residuals absorb a wrong model, so residuals in units of them cannot
be large. In units of the stated noise they can. Each squared residual is divided by its variance and by 1 − leverage.
The **misfit** of an image, of a region of the object, or of all is the square root of the median of these squares,
relative to that of a Gaussian. With thousands of measurements the misfit of any sound capture differs significantly
from 1, because every model is a little wrong. The stated probability is therefore that of a *sound capture* fitting as
badly, from the distribution of the misfit over captures of random objects.
"""

from dataclasses import dataclass
from math import erfc, exp, log, sqrt

import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.result import GoodnessOfFit
from acquisition.models.tuned import tuned
from acquisition.normals.pixels.pixel_solve import Estimate
from acquisition.normals.uncertainty import residual_noise

GAUSSIAN_MEDIAN_SQUARE = photometry.GAUSSIAN_MEDIAN_DEVIATION**2
"""Median of the square of a standard Gaussian."""


@dataclass(frozen=True)
class GoodnessOfFitSettings:
    """Tuned numbers of the probability of a misfit."""

    log_misfit_mean: float = tuned(-0.35, "1")
    """Mean of the logarithm of the misfit of sound captures. Set between two samples of design seeds: −0.45 over 44
    Lambertian captures, −0.16 over 160 captures, rough and translucent ones among them."""
    log_misfit_sd: float = tuned(0.4, "1")
    """Standard deviation of the logarithm of the misfit of sound captures. In the same two samples it is 0.55 and 0.48.
    With the first sample's numbers a misfit of 2.5 has a probability of 0.7 %, with the second's 1.2 %, with the
    numbers set here 0.1 %."""

    @property
    def median_misfit(self) -> float:
        """Median of the misfit of sound captures."""
        return exp(self.log_misfit_mean)


SETTINGS = GoodnessOfFitSettings()

GRID = 4
"""Rows and columns of the grid of regions, over the object's bounding box, whose misfit is stated."""


@dataclass(frozen=True)
class Fit:
    """Misfit of all measurements, of each image (F,) and of each region (GRID, GRID), NaN where these are too few; mean
    of Cauchy's loss, which the pixels' solves minimise; median residual over value (no noise model)."""

    misfit: float
    loss: float
    relative_residual: float
    images: FloatArray
    regions: FloatArray

    @property
    def redundant(self) -> bool:
        """Whether there are enough images to judge a model. Four leave one residual per pixel, which distinguishes
        gloss from wrong normals, but not from all the other models."""
        return len(self.images) >= photometry.REDUNDANT

    @property
    def probability(self) -> float:
        """Probability that a sound capture fits as badly or worse (one-sided, log-normal)."""
        return probability(self.misfit)

    def summary(self) -> GoodnessOfFit | None:
        """Returns the fit as stored with a result, with none for NaN; none as a whole if the images are too few."""
        if not self.redundant or not np.isfinite(self.misfit):
            return None

        def known(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return GoodnessOfFit(
            misfit=self.misfit,
            probability=self.probability,
            image_misfits=[known(one) for one in self.images],
            image_probabilities=[None if known(one) is None else probability(one) for one in self.images],
            region_misfits=[[known(one) for one in row] for row in self.regions],
        )


def probability(misfit: float) -> float:
    """Returns the upper tail probability of the log-normal distribution of sound captures' misfit."""
    return 0.5 * erfc((log(max(misfit, 1e-6)) - SETTINGS.log_misfit_mean) / SETTINGS.log_misfit_sd / sqrt(2))


def evaluate(estimate: Estimate, values: Float32Array, stated: Noise, extra: Float32Array, place: FloatArray) -> Fit:
    """Evaluates the fit of K pixels' `estimate` to the `values` (F, K) that it was solved from, in the `stated` noise.

    `extra` (F, K) is variance beyond the noise model's; `place` (2, K) are row and column in the bounding box, 0–1.
    """
    squares, relative, used = residual_noise.studentised_squares(estimate, values, stated, extra)
    cell = np.clip((place * GRID).astype(int), 0, GRID - 1)
    regions = np.full((GRID, GRID), np.nan)
    for row in range(GRID):
        for column in range(GRID):
            inside = (cell[0] == row) & (cell[1] == column)
            regions[row, column] = _misfit(squares[:, inside], used[:, inside])
    images = np.array([_misfit(one, valid) for one, valid in zip(squares, used, strict=True)])
    relative_residual = float(np.sqrt(np.median(relative[used]))) if np.any(used) else float("nan")
    return Fit(_misfit(squares, used), _loss(squares, used), relative_residual, images, regions)


def _misfit(squares: FloatArray, used: BoolArray) -> float:
    if np.count_nonzero(used) < photometry.SETTINGS.min_sample:
        return float("nan")
    return float(np.sqrt(np.median(squares[used]) / GAUSSIAN_MEDIAN_SQUARE))


def _loss(squares: FloatArray, used: BoolArray) -> float:
    if np.count_nonzero(used) < photometry.SETTINGS.min_sample:
        return float("nan")
    return float(photometry.CAUCHY_SCALE**2 * np.mean(np.log1p(squares[used] / photometry.CAUCHY_SCALE**2)))
