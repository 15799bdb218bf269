"""Photon transfer: a sensor's gain and read noise from how its values scatter at each brightness.

Electrons are counted with the variance of their number, so the variance of values grows with brightness by one over the
gain (electrons per value), from what reading and rounding add in the dark (Janesick, Photon Transfer, 2007; EMVA 1288,
release 4.0, section 6). What scatters are differences among four neighbours of the difference of two frames: everything
that both frames share cancels in the second, fixed pattern included, and in the first whatever varies slowly over the
image, as when a lamp came back a little brighter or a little beside its place. What is left at edges is no noise; so
the variance of each bin of brightness is that of its middle, not of its tails, and a bin with many tails is no
measurement.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray

BINS = 24
"""Bins of brightness, of equal width in its root, as noise is; each many times as wide as noise, which would else sort
pixels of one brightness into bright and dark ones and make the curve flat."""

MIN_BIN_COUNT = 100
MIN_VARIANCE_STEPS = 0.3
"""Variance, in squared steps of rounding, below which a bin tells nothing: values hardly scatter over their steps, and
rounding adds something else than a twelfth."""

CLIP_SIGMA = 3.0
CLIPPED_GAUSSIAN_VARIANCE = 0.97334
"""Variance of a Gaussian cut off at CLIP_SIGMA σ, as a share of the whole one's."""

MAX_TAIL_SHARE = 0.04
"""Share of a bin's differences beyond CLIP_SIGMA σ, a Gaussian's being 0.003, from which the bin is left out: edges of
shadows, or all that has edges when the scene has moved."""

CLIP_ITERATIONS = 12
INITIAL_SAMPLE = 2000
"""Differences of a bin that its clipping starts from."""

GAUSSIAN_MEDIAN_DEVIATION = 0.67449
VARIANCE_SIGMA = 0.01
"""1 σ of a bin's variance beside chance, as a share of it: of tails that are not quite Gaussian."""

ROUNDING_SIGMA = 0.06
"""The same of clipping values that are rounded to steps, times the squared step over the variance."""

PATTERN_SIGMA = 0.001
"""1 σ of what two frames differ by from pixel to pixel in proportion to brightness, where a lamp came back beside its
place: a term in its square, which would else be taken for photons."""

OUTLIER_SIGMA = 4.0
"""σ off the line from which a point is no longer believed."""

IRLS_ITERATIONS = 8


@dataclass(frozen=True)
class TransferCurve:
    """A photon-transfer curve: mean brightness (B,), variance (B,) of one frame's values there, its relative 1 σ."""

    level: FloatArray
    variance: FloatArray
    relative: FloatArray


@dataclass(frozen=True)
class LinearFit:
    """Variance = slope · brightness + floor, each with its 1 σ."""

    slope: float
    slope_sigma: float
    floor: float
    floor_sigma: float


def transfer_curve(level: np.ndarray, difference: np.ndarray, top: float, step: float) -> TransferCurve:
    """The curve of differences (N,) that scatter as one frame's values do at a brightness of `level` (N,) up to `top`.

    `step` is the rounding of values; brightness that scatters over less than its steps is left out.
    """
    place = np.clip(np.sqrt(np.maximum(level, 0)) * (BINS / np.sqrt(top)), 0, BINS - 1).astype(np.uint8)
    order = np.argsort(place, kind="stable")
    ends = np.cumsum(np.bincount(place, minlength=BINS))
    squares = np.square(difference[order], dtype=np.float64)
    level = level[order]
    found: list[tuple[float, float, float]] = []
    for start, stop in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True):
        if stop - start >= MIN_BIN_COUNT:
            here = squares[start:stop]
            mean = float(np.mean(level[start:stop], dtype=np.float64))
            variance = _core_variance(here, step)
            if variance > MIN_VARIANCE_STEPS * step**2:
                chance = 2.3 / (stop - start)  # clipping costs a little of the efficiency
                relative = np.sqrt(chance + VARIANCE_SIGMA**2 + (ROUNDING_SIGMA * step**2 / variance) ** 2)
                found.append((mean, variance, float(relative)))
    rows = np.array(found).reshape(-1, 3)
    return TransferCurve(rows[:, 0], rows[:, 1], rows[:, 2])


def concatenate(curves: list[TransferCurve]) -> TransferCurve:
    """The points of several curves of one sensor."""
    return TransferCurve(
        *(np.concatenate([getattr(curve, name) for curve in curves]) for name in ("level", "variance", "relative"))
    )


def fit_line(curve: TransferCurve) -> LinearFit | None:
    """The line through a curve by weighted least squares; none when it has fewer than three points.

    A term in the square of brightness takes up what is in proportion to it. Points far off the line are hardly
    believed. Errors are those of the fit, larger by as much as believed points scatter more than chance has it.
    """
    if len(curve.level) < 3:
        return None
    design = np.stack([curve.level, np.ones_like(curve.level), curve.level**2], axis=1)
    prior = np.diag([0.0, 0.0, PATTERN_SIGMA**-4])
    expected = np.maximum(curve.variance, 1e-30)
    belief = np.ones_like(expected)
    solution, inverse, off = np.zeros(3), np.zeros((3, 3)), np.zeros_like(expected)
    for _ in range(IRLS_ITERATIONS):
        weight = belief / (curve.relative * expected) ** 2
        scale = 1 / np.sqrt(np.maximum(np.sum(weight[:, None] * design**2, axis=0), 1e-300))
        normal = (design * weight[:, None]).T @ design + prior
        inverse = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-12) * np.outer(scale, scale)
        solution = inverse @ (design.T @ (weight * curve.variance))
        expected = np.maximum(design @ solution, 0.2 * expected)
        off = (curve.variance - design @ solution) / (curve.relative * expected)
        belief = 1 / (1 + (off / OUTLIER_SIGMA) ** 2) ** 2
    misfit = np.sum(belief * off**2) / max(float(np.sum(belief)) - 2, 1.0)
    larger = np.sqrt(max(1.0, float(misfit)))
    sigma = larger * np.sqrt(np.diag(inverse))
    return LinearFit(float(solution[0]), float(sigma[0]), float(solution[1]), float(sigma[1]))


def _core_variance(squares: FloatArray, step: float) -> float:
    """The variance of a Gaussian that `squares` (N,) are of, but for tails of something else; 0: too many tails."""
    few = squares[:: max(1, len(squares) // INITIAL_SAMPLE)]
    variance = float(np.median(few)) / GAUSSIAN_MEDIAN_DEVIATION**2 + step**2 / 12
    for _ in range(CLIP_ITERATIONS):
        kept = squares[squares < CLIP_SIGMA**2 * variance]
        if not len(kept):
            return 0.0
        before, variance = variance, float(np.mean(kept)) / CLIPPED_GAUSSIAN_VARIANCE
        if abs(variance - before) < 1e-4 * before:
            break
    return variance if np.count_nonzero(squares > CLIP_SIGMA**2 * variance) < MAX_TAIL_SHARE * len(squares) else 0.0
