"""Photon transfer: a sensor's gain and read noise from the variance of its values at each brightness (EMVA 1288).

The variance of values is a line in brightness. Its slope is one over the gain (electrons per value), and its value in
the dark is the variance of reading and rounding (Janesick, Photon Transfer, 2007; EMVA 1288, release 4.0, section 6).
Variances are estimated from differences among four neighbours of the difference of two frames. The difference of frames
cancels everything that both share, fixed pattern included. The difference of neighbours cancels what varies slowly over
the image, as when a lamp came back slightly brighter or displaced. Differences at edges are not noise, so the variance
of each bin of brightness is estimated from its core by σ-clipping, and a bin with many outliers is dropped.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from acquisition import photometry
from acquisition.models.base import FloatArray, FloatT
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class TransferSettings:
    """Tuned numbers of the photon-transfer curve."""

    max_tail_share: float = tuned(0.04, "share")
    """Share of a bin's differences beyond CLIP_SIGMA σ, 0.003 for a Gaussian, from which the bin is dropped. Such
    outliers are edges of shadows, or all edges if the scene has moved. Measured without edges on 120 synthetic sensors
    of gains 0.1–10: 0.91 of the gains are known, with half 0.91, with twice 0.90 (scratch evaluation, November
    2026)."""
    rounding_sigma: float = tuned(0.06, "1")
    """1 σ of a bin's variance beyond its sampling error, by clipping of quantised values. As a share of the variance it
    is this number times step² / variance. Measured: without it the noise of a sensor that reads with 0.8 steps is 5 %
    too small, 5 of its σ (`test_fit_line_synthetic_sensor_recovers_gain_and_read_noise`); with 0.083 its 1 σ is over a
    tenth of it. Errors of the same 120 sensors' floors are 0.80 of their σ (rms), with half 0.90, with twice 0.69."""
    pattern_sigma: float = tuned(0.001, "share")
    """1 σ of the difference of two frames from pixel to pixel, as a share of brightness, if a lamp came back displaced.
    Its variance is a term in the square of brightness that would otherwise count as photons. Measured on the same 120
    sensors, with patterns of 0–0.0015: 0.91 are known, and errors of their gains are 0.96 σ (rms); with half as much
    0.92 and 1.05, with twice 0.84 and 0.84."""
    max_relative_sigma: float = tuned(0.05, "share")
    """1 σ of an estimate of gain or read noise, as a share of it, up to which it replaces the stated value. A larger
    limit accepts wrong estimates: a scene of fine detail that has moved between its two frames gives a gain that is
    wrong a thousandfold, with a σ of 7–8 % (scratch evaluation, November 2026;
    `test_estimate_fine_detail_shifted_keeps_calibration`). Of the same 120 sensors 0.91 are known, to 2.4 % (rms); with
    half as much 0.62, to 1.4 %; with twice all, to 2.9 %."""


SETTINGS = TransferSettings()

ScalarT = TypeVar("ScalarT", bound=np.generic)

BINS = 24
"""Bins of brightness, of equal width in its square root, in which the noise is uniform. Each is many times as wide as
the noise, which would otherwise sort pixels of one brightness into bright and dark ones and flatten the curve."""

CLIP_SIGMA = 3.0
"""σ beyond which differences are clipped."""

CLIPPED_GAUSSIAN_VARIANCE = 0.97334
"""Variance of a Gaussian truncated at CLIP_SIGMA σ, as a share of that of the full one."""

CLIP_ITERATIONS = 12
"""Largest number of iterations of σ-clipping."""

INITIAL_SAMPLE = 2000
"""Differences of a bin from which its initial variance is estimated."""

STRIPS = 16
"""Strips of rows that are read, spread over a window; more do not improve the estimate."""

IRLS_ITERATIONS = 8
"""Iterations of the reweighted line fit."""


@dataclass(frozen=True)
class TransferCurve:
    """A photon-transfer curve: mean brightness (B,), variance (B,) of one frame's values, its relative 1 σ (B,)."""

    level: FloatArray
    variance: FloatArray
    relative: FloatArray


@dataclass(frozen=True)
class LinearFit:
    """Variance = slope · brightness + floor, each with its 1 σ, and the covariance of the two."""

    slope: float
    slope_sigma: float
    floor: float
    floor_sigma: float
    covariance: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the slope, one over the gain, is known well enough to replace the stated value."""
        return self.slope > 0 and self.slope_sigma <= SETTINGS.max_relative_sigma * self.slope


def strips(height: int, most_rows: int) -> list[slice]:
    """Returns strips of pairs of rows, spread over `height` rows: at most `most_rows` in all, but at least two each."""
    each = max(2, min(-(-height // STRIPS), most_rows // STRIPS) // 2 * 2)
    starts = range(0, height, each) if each * STRIPS >= height else np.linspace(0, height - each, STRIPS).astype(int)
    return [slice(int(start), min(int(start) + each, height)) for start in starts]


def quads(image: NDArray[ScalarT]) -> NDArray[ScalarT]:
    """Returns the corners (4, h/2, w/2) of each 2 × 2 square of an image (h, w), row by row."""
    height, width = (length // 2 * 2 for length in image.shape)
    return np.stack([image[row:height:2, column:width:2] for row in (0, 1) for column in (0, 1)])


def quad_differences(corners: NDArray[FloatT], axis: int = 0) -> NDArray[FloatT]:
    """Returns the mixed difference of four neighbours along an axis, scaled to the variance of one of them."""
    one, right, below, across = np.moveaxis(corners, axis, 0)
    return np.asarray((one - right - below + across) / 2, corners.dtype)


def transfer_curve(level: np.ndarray, difference: np.ndarray, top: float, step: float) -> TransferCurve:
    """Builds the photon-transfer curve of differences (N,), of one frame's variance, at `level` (N,) up to `top`.

    `step` is the quantisation of values. If the noise is less than half a step, quantisation does not add a twelfth of
    the squared step (Widrow & Kollár, Quantization Noise, 2008), and the bin is dropped.
    """
    rounding = step**2 / 12
    bin_number = np.clip(np.sqrt(np.maximum(level, 0)) * (BINS / np.sqrt(top)), 0, BINS - 1).astype(np.uint8)
    order = np.argsort(bin_number, kind="stable")
    ends = np.cumsum(np.bincount(bin_number, minlength=BINS))
    squares = np.square(difference[order], dtype=np.float64)
    level = level[order]
    bins: list[tuple[float, float, float]] = []
    for start, stop in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True):
        if stop - start >= photometry.SETTINGS.min_sample:
            members = squares[start:stop]
            mean = float(np.mean(level[start:stop], dtype=np.float64))
            variance = _core_variance(members, rounding)
            if variance > step**2 / 4 + rounding:
                sampling = 2.3 / (stop - start)  # clipping reduces the efficiency a little
                relative = np.sqrt(sampling + (SETTINGS.rounding_sigma * step**2 / variance) ** 2)
                bins.append((mean, variance, float(relative)))
    return TransferCurve(*np.array(bins).reshape(-1, 3).T)


def concatenate(curves: list[TransferCurve]) -> TransferCurve:
    """Returns the points of several curves of one sensor as one curve."""
    parts = ([curve.level, curve.variance, curve.relative] for curve in curves)
    return TransferCurve(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def fit_line(curve: TransferCurve) -> LinearFit | None:
    """Fits a line to a photon-transfer curve by iteratively reweighted least squares; none below three points.

    Cauchy weights reduce the influence of outliers. A term in the square of brightness, with a prior, absorbs
    differences in proportion to brightness. σ is that of the fit, times the root of the reduced χ² if that is above 1.
    """
    if len(curve.level) < 3:
        return None
    design = np.stack([curve.level, np.ones_like(curve.level), curve.level**2], axis=1)
    prior = np.diag([0.0, 0.0, SETTINGS.pattern_sigma**-4])
    expected = np.maximum(curve.variance, 1e-30)
    robust = np.ones_like(expected)
    solution, inverse, off = np.zeros(3), np.zeros((3, 3)), np.zeros_like(expected)
    for _ in range(IRLS_ITERATIONS):
        weight = robust / (curve.relative * expected) ** 2
        scale = 1 / np.sqrt(np.maximum(np.sum(weight[:, None] * design**2, axis=0), 1e-300))
        normal = (design * weight[:, None]).T @ design + prior
        inverse = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-12) * np.outer(scale, scale)
        solution = inverse @ (design.T @ (weight * curve.variance))
        expected = np.maximum(design @ solution, 0.2 * expected)
        off = (curve.variance - design @ solution) / (curve.relative * expected)
        robust = 1 / (1 + (off / photometry.CAUCHY_SCALE) ** 2)
    misfit = np.sum(robust * off**2) / max(float(np.sum(robust)) - 2, 1.0)
    larger = np.sqrt(max(1.0, float(misfit)))
    sigma = larger * np.sqrt(np.diag(inverse))
    covariance = float(larger**2 * inverse[0, 1])
    return LinearFit(float(solution[0]), float(sigma[0]), float(solution[1]), float(sigma[1]), covariance)


def _core_variance(squares: FloatArray, rounding: float) -> float:
    """Estimates the variance of a Gaussian with outliers from `squares` (N,) by σ-clipping, starting at no less than
    that of `rounding`; 0: too many outliers."""
    sample = squares[:: max(1, len(squares) // INITIAL_SAMPLE)]
    variance = float(np.median(sample)) / photometry.GAUSSIAN_MEDIAN_DEVIATION**2 + rounding
    for _ in range(CLIP_ITERATIONS):
        kept = squares[squares < CLIP_SIGMA**2 * variance]
        if not len(kept):
            return 0.0
        before, variance = variance, float(np.mean(kept)) / CLIPPED_GAUSSIAN_VARIANCE
        if abs(variance - before) < 1e-4 * before:
            break
    tail = np.count_nonzero(squares > CLIP_SIGMA**2 * variance)
    return variance if tail < SETTINGS.max_tail_share * len(squares) else 0.0
