"""Tests of lights and images: axes of the lamps mirrored, exchanged or turned, two lamps swapped, one image bad.

Other axes in the lights' file leave every residual as it is, because normals that are mirrored or turned likewise
explain the images as well. Circulation and outline of the normals reveal them.

Slopes of a surface have no **circulation**: ∂p/∂y = ∂q/∂x. Turned by φ about the camera's axis, they have sin φ times
their divergence; mirrored slopes have that of another field. So of all axes, mirrored or not and turned by any angle,
the right ones and their opposite have the least circulation. Measured: this holds for all 16 objects of design seeds 60
and 62, eight lights, sound (circulation 0.25–0.90 of the next best quarter turn's) and mirrored in either axis
(0.36–0.91). The angle found is 2° at most in sound captures, and within 2° where lamps are turned by 10° (design
seeds 60, 62 and 63, ten lights in two rings; scratch scripts, November 2026).

A half turn exchanges hollow and raised and keeps the circulation, but at the silhouette the normals of a solid point
outwards. **Outwardness** is the mean cosine of their image-plane part with the silhouette's outward direction. The
least-squares residual halves if the right pair of swapped lamps is exchanged, and falls without one bad image.
"""

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.normals.pixels.pixel_solve import Pixels

MAX_TEST_PIXELS = 400
"""Largest number of pixels in tests by least squares."""

MAX_SWAPPED = 8
"""Images among which a pair of swapped lamps is sought, by the residual without each. Measured: in 15 captures of 24
lights in which an exchange halves the residual, the pair is the first two (design seeds 419 and 420)."""


STATED_AXES = np.eye(2)
"""Axes as stated: the 2 × 2 matrix by which the lamps' x and y are multiplied."""

SIDES = (np.diag([1.0, 1.0]), np.diag([-1.0, 1.0]))
"""Axes as stated and with x mirrored, before they are turned."""

QUARTER_AXES = tuple(turn @ side for side in SIDES for turn in (STATED_AXES, np.array([[0.0, -1.0], [1.0, 0.0]])))
"""Axes turned by quarters, without their opposites: the stated ones, the other unmirrored ones, the mirrored ones."""

TURNS_DEG = np.arange(-90.0, 90.0, 6.0)
"""Angles, degrees, by which axes are turned on trial, with quarter turns among them. Between them a parabola
interpolates the circulation. The least turn that counts is half a step; in sound captures up to 2° are found."""

NEAR = 0.1
"""Width of an object over the distance of its lamps, above which near light distinguishes hollow from raised. It is
0.2–0.7 in a cell, 0.001 where lamps are stated as directions."""

INWARDS = -0.55
"""Outwardness below which all of an outline counts as pointing inwards. Measured: at least −0.42 in 140 objects of
design seeds 460–479, with bowls, at least −0.30 in 48 others (486–491); −0.8 of a ball under opposite lamps."""

REGIONS = 8
"""Rows and columns of regions of the object; the scatter of their circulations says how significant the sum is."""


@dataclass(frozen=True)
class Outline:
    """Pixel numbers (R,) of the rim, and the silhouette's outward directions there (2, R), view frame."""

    numbers: np.ndarray
    outward: Float32Array


def outline(pixels: Pixels) -> Outline:
    """Returns the rim of the object's silhouette and its outward directions."""
    inside, width = pixels.image(np.ones(len(pixels.index), np.float32)), photometry.SETTINGS.edge_px
    padded = cv2.copyMakeBorder(inside, width, width, width, width, cv2.BORDER_CONSTANT, value=0)
    core = cv2.erode(padded, np.ones((2 * width + 1, 2 * width + 1), np.uint8))
    smooth = cv2.GaussianBlur(padded, (0, 0), width)
    slope = np.stack([-cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)])
    window = (slice(width, -width), slice(width, -width))
    length = np.linalg.norm(slope, axis=0)[window]
    rim = (inside > 0) & (core[window] == 0) & (length > 0.1)
    numbers = np.flatnonzero(pixels.take(rim))
    outward = pixels.take(slope[(slice(None), *window)])[:, numbers]
    return Outline(numbers, outward / np.linalg.norm(outward, axis=0))


def outwardness(normals: Float32Array, rim: Outline) -> float | None:
    """Returns the mean cosine of normals (3, N), in the image plane, with outward directions; none: too short a rim."""
    if len(rim.numbers) < photometry.SETTINGS.min_sample:
        return None
    return float(np.mean(np.sum(normals[:2, rim.numbers] * rim.outward, axis=0)))


def near(pixels: Pixels, depth_m: Float32Array, lamps: Float32Array) -> bool:
    """Returns whether the object at depth (N,), m, is wide for the distance of its lamps (F, 6 or 9). Then their light
    distinguishes hollow from raised."""
    points = photometry.points(pixels.ray, depth_m)
    distances = np.linalg.norm(lamps[:, :3] - np.mean(points, axis=1), axis=1)
    return bool(np.max(np.ptp(points[:2], axis=1)) > NEAR * np.median(distances))


@dataclass(frozen=True)
class IntegrableAxes:
    """Axes (2, 2) under which normals have the least circulation; the opposite axes have the same.

    - `best`: of all axes; `unmirrored`: of those not mirrored; `quarter`: of those turned by quarters.
    - `turned`: the best of either side, mirrored or not, if significantly better than its quarter turns and not
      significantly worse than the other side.
    - `sure`: if `turned` has any, `best` is significantly better than any quarter turn; if not, `quarter` than the
      stated axes.
    """

    best: FloatArray
    unmirrored: FloatArray
    quarter: FloatArray
    turned: tuple[FloatArray, ...]
    sure: bool


def integrable_axes(pixels: Pixels, normals: Float32Array) -> IntegrableAxes:
    """Returns the axes under which normals (3, N), view frame, have the least circulation.

    Axes are as stated or with one axis mirrored, and turned by any angle. The cost is a sum over the cells of four
    neighbouring pixels, which are the same under all axes, of the arctangent of the circulation in slopes a pixel. The
    arctangent bounds a crease, round which any normals circulate, at 90°. Both sides may have the least circulation,
    because mirrored slopes of a paraboloid or a saddle are a surface's, too.
    """
    slope = -normals[:2] / np.maximum(normals[2], np.float32(photometry.SETTINGS.min_view_cosine))
    image = pixels.image(slope.astype(np.float32), np.nan)
    up = (image[:, :-1, :-1] + image[:, :-1, 1:] - image[:, 1:, :-1] - image[:, 1:, 1:]) / 2
    right = (image[:, :-1, 1:] + image[:, 1:, 1:] - image[:, 1:, :-1] - image[:, :-1, :-1]) / 2
    known = np.isfinite(up[0])
    up, right, region = up[:, known], right[:, known], _regions(known)

    def circulation(axes: FloatArray) -> FloatArray:
        around = np.arctan(np.abs(axes[0] @ up - axes[1] @ right))
        return np.asarray(np.bincount(region, around, REGIONS**2), np.float64)

    quarters = [_Trial(axes, circulation(axes)) for axes in QUARTER_AXES]
    best: list[_Trial] = []
    for side in SIDES:
        costs = np.array([circulation(turned_by(turn) @ side) for turn in TURNS_DEG])
        total = np.sum(costs, axis=1)
        least = int(np.argmin(total))
        turn = TURNS_DEG[least] + (TURNS_DEG[1] - TURNS_DEG[0]) * _parabola_minimum(total)
        best.append(_Trial(turned_by(turn) @ side, costs[least]))
    first, quarter = min(best, key=_Trial.total), min(quarters, key=_Trial.total)
    turned = tuple(
        one.axes
        for one, own in zip(best, (quarters[:2], quarters[2:]), strict=True)
        if one.better(min(own, key=_Trial.total)) and not first.better(one)
    )
    sure = first.better(quarter) if turned else quarter.better(quarters[0])
    return IntegrableAxes(first.axes, best[0].axes, quarter.axes, turned, sure)


@dataclass(frozen=True)
class _Trial:
    """Axes (2, 2) with their circulation by region (R,)."""

    axes: FloatArray
    circulation: FloatArray

    def total(self) -> float:
        return float(np.sum(self.circulation))

    def better(self, other: "_Trial") -> bool:
        """Returns whether their circulation is significantly less: by 3 σ of the sum of what regions gain.

        Measured: 0–2.0 σ where a turn is compared with quarter turns in sound captures, or of planes with white or
        blurred noise; 4–13 σ under lamps turned by 10°, except machined parts (1.6), whose flat faces hardly tell
        (design seeds 60, 62 and 63, ten lights in two rings).
        """
        gained = other.circulation - self.circulation
        sigma = float(np.sqrt(len(gained)) * np.std(gained, ddof=1))
        return float(np.sum(gained)) > photometry.SETTINGS.outlying_deviations * max(sigma, 1e-12)


def _regions(known: BoolArray) -> np.ndarray:
    """Returns the region number (N,) of each pixel of a mask (h, w); regions are quantiles of rows and of columns."""
    if not np.any(known):  # an object so thin that no four pixels are neighbours
        return np.zeros(0, np.intp)
    row, column = (
        np.searchsorted(np.quantile(at, np.arange(1, REGIONS) / REGIONS), at, side="right") for at in np.nonzero(known)
    )
    return REGIONS * row + column


def _parabola_minimum(costs: FloatArray) -> float:
    """Returns the minimum, in steps from the least of periodic `costs`, of the parabola through it and its
    neighbours."""
    least = int(np.argmin(costs))
    before, after = costs[least - 1], costs[(least + 1) % len(costs)]
    bend = float(before + after - 2 * costs[least])
    return float(before - after) / (2 * bend) if bend > 0 else 0.0


def turned_by(degrees: float) -> FloatArray:
    """Returns the matrix (2, 2) of a turn from x towards y; quarter turns are exact."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cosine, -sine], [sine, cosine]]).round(12) + 0.0


def turn_deg(axes: FloatArray) -> float:
    """Returns the turn from x towards y in axes (2, 2), degrees within ±180; x may be mirrored before it."""
    side = np.sign(np.linalg.det(axes))
    return float(np.degrees(np.arctan2(side * axes[1, 0], side * axes[0, 0])))


def transformed(lamps: Float32Array, axes: FloatArray) -> Float32Array:
    """Returns lamps (F, 6 or 9) with the x and y of positions, optical axes and tilts multiplied by a matrix (2, 2)."""
    out = lamps.copy()
    matrix = axes.astype(np.float32)
    for first in range(0, lamps.shape[1], 3):
        out[:, first : first + 2] = lamps[:, first : first + 2] @ matrix.T
    return out


@dataclass(frozen=True)
class Swap:
    """Two images (numbers) whose lamps are best exchanged, and the least-squares residual after over that before."""

    first: int
    second: int
    residual_share: float


def swapped_pair(pixels: Pixels, depth_m: Float32Array, lamps: Float32Array, calibration: Calibration) -> Swap:
    """Returns the pair of lamps whose exchange lowers the least-squares residual at depth (N,), m, most. Pairs are
    sought among the images without which the others fit best."""
    rows, values, used = _equations(pixels, depth_m, lamps, calibration)
    before, order = _residual(rows, values, used), np.arange(len(lamps))
    worst = np.sort(np.argsort(_residuals_without(rows, values, used), kind="stable")[:MAX_SWAPPED])
    pairs = list(combinations(worst.tolist(), 2))
    after = [
        _residual(rows[:, np.where(order == a, b, np.where(order == b, a, order))], values, used) for a, b in pairs
    ]
    best = int(np.argmin(after))
    return Swap(*pairs[best], after[best] / before)


def relative_residual(
    pixels: Pixels, depth_m: Float32Array, lamps: Float32Array, others: Float32Array, calibration: Calibration
) -> float:
    """Returns the least-squares residual under `others` (F, 6 or 9) over that under `lamps`, at depth (N,), m. It is 1
    in distant light, which fits under mirrored and turned lamps alike."""
    after, before = (_residual(*_equations(pixels, depth_m, one, calibration)) for one in (others, lamps))
    return after / max(before, 1e-12)


@dataclass(frozen=True)
class WorstImage:
    """The image (number) without which the others fit best, and the residual then over that without another image."""

    number: int
    residual_share: float


def worst_image(
    pixels: Pixels, depth_m: Float32Array, lamps: Float32Array, calibration: Calibration
) -> WorstImage | None:
    """Returns the worst image by a leave-one-out test with least squares; none: only four images or fewer are left.

    The test uses the values (F, N) of `pixels` at depth (N,), m. The image that fits worst need not be the bad one,
    because a bright image draws the normals towards it, and others then fit worse. Measured: in 48 captures with a
    flash in one image the largest residual of the fit names it in 27, this test in 47.
    """
    rows, values, used = _equations(pixels, depth_m, lamps, calibration)
    left = np.flatnonzero(np.any(used, axis=0))
    if len(left) <= photometry.OVERDETERMINED:
        return None
    residuals = _residuals_without(rows, values, used)[left]
    least = int(np.argmin(residuals))
    return WorstImage(int(left[least]), float(residuals[least] / np.median(np.delete(residuals, least))))


def _equations(
    pixels: Pixels, depth_m: Float32Array, lamps: Float32Array, calibration: Calibration
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Returns light vectors (K, F, 3) and values (K, F) of some pixels, and which are lit and not clipped (K, F)."""
    chosen = np.unique(np.linspace(0, len(pixels.index) - 1, min(MAX_TEST_PIXELS, len(pixels.index))).astype(int))
    few = pixels.subset(chosen)
    light = photometry.light_vectors(photometry.points(few.ray, depth_m[chosen]), lamps, calibration)
    values = few.values.T.astype(np.float64)
    used = (values > SolveSettings().shadow_threshold * np.max(values, axis=1, keepdims=True)) & ~few.clipped.T
    return light.transpose(2, 0, 1).astype(np.float64), values, used


def _residuals_without(rows: FloatArray, values: FloatArray, used: BoolArray) -> FloatArray:
    """Returns `_residual` without each image (F,)."""
    image = np.arange(rows.shape[1])
    return np.array([_residual(rows, values, used & (image != one)) for one in image])


def _residual(rows: FloatArray, values: FloatArray, used: BoolArray) -> float:
    """Returns the median over pixels of the rms residual of least squares over the rms value; 1 where no pixel has
    four. Light vectors are (K, F, 3), values and which of them are used (K, F)."""
    weighted = np.swapaxes(rows * used[:, :, None], 1, 2)
    matrix = weighted @ rows
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2) + 1e-15)[:, None, None] * np.eye(3)
    g = np.linalg.solve(matrix, weighted @ values[:, :, None])
    residual = (values - (rows @ g)[:, :, 0]) * used
    enough = np.count_nonzero(used, axis=1) >= photometry.OVERDETERMINED
    if not np.any(enough):
        return 1.0
    return float(np.median(np.sum(residual[enough] ** 2, axis=1) / np.sum((values * used)[enough] ** 2, axis=1)) ** 0.5)
