"""Tests of the stated lights: axes of the lamps mirrored or exchanged, and two images' lamps swapped.

Other axes in the lights' file leave every residual as it is: the images are as well explained by normals that are
mirrored or turned likewise. Two things tell. Slopes of a surface have no circulation, ∂p/∂y = ∂q/∂x; after a
mirroring, an exchange or a quarter turn of the axes they have, since the mixed derivative changes its sign or the
others take its place. So of the eight versions of the axes the right one and its opposite have the least circulation:
of 16 objects of design seeds 60 and 62, eight lights, it did of all, sound (circulation 0.25–0.90 of the next best)
and mirrored in either axis (0.36–0.91; scratch script, November 2026). A half turn exchanges hollow and raised, and
keeps the circulation: there the outline tells. At the silhouette the normals of a solid point outwards:
**outwardness** is the mean cosine between the image-plane part of the normals and the silhouette's outward direction.
Two lamps swapped show in the residual of least squares, which halves when the right pair is swapped back.
"""

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.models.tuned import tuned
from acquisition.normals.pixel_solve import Pixels

MAX_SWAP_PIXELS = 400
"""Pixels of the swap test; with F lights it solves F (F − 1) / 2 times as many systems of three."""


@dataclass(frozen=True)
class LightTestSettings:
    """Tuned numbers of the tests of lamps and axes."""

    rim_px: int = tuned(3, "px")
    """Width of the rim along the silhouette whose normals count, in pixels of the coarse grid."""


SETTINGS = LightTestSettings()

Axes = tuple[tuple[int, int], tuple[int, int]]
"""A signed permutation of image axes: rows of the 2 × 2 matrix that the lamps' x and y are multiplied by."""

STATED_AXES: Axes = ((1, 0), (0, 1))
OPPOSITE_AXES: tuple[tuple[Axes, Axes], ...] = (
    (STATED_AXES, ((-1, 0), (0, -1))),
    (((-1, 0), (0, 1)), ((1, 0), (0, -1))),
    (((0, 1), (1, 0)), ((0, -1), (-1, 0))),
    (((0, -1), (1, 0)), ((0, 1), (-1, 0))),
)
"""The eight versions of two axes in pairs of opposite ones: as stated, one mirrored, exchanged, a quarter turn."""


@dataclass(frozen=True)
class Outline:
    """Pixels of the rim (R,) by number, and the silhouette's outward directions there (2, R), view frame."""

    numbers: np.ndarray
    outward: Float32Array


def outline(pixels: Pixels) -> Outline:
    """The rim of the object's silhouette and its outward directions."""
    inside = pixels.image(np.ones(len(pixels.index), np.float32))
    padded = cv2.copyMakeBorder(
        inside, SETTINGS.rim_px, SETTINGS.rim_px, SETTINGS.rim_px, SETTINGS.rim_px, cv2.BORDER_CONSTANT, value=0
    )
    core = cv2.erode(padded, np.ones((2 * SETTINGS.rim_px + 1, 2 * SETTINGS.rim_px + 1), np.uint8))
    smooth = cv2.GaussianBlur(padded, (0, 0), SETTINGS.rim_px)
    slope = np.stack([-cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)])
    window = (slice(SETTINGS.rim_px, -SETTINGS.rim_px), slice(SETTINGS.rim_px, -SETTINGS.rim_px))
    length = np.linalg.norm(slope, axis=0)[window]
    rim = (inside > 0) & (core[window] == 0) & (length > 0.1)
    numbers = np.flatnonzero(pixels.take(rim))
    outward = pixels.take(slope[(slice(None), *window)])[:, numbers]
    return Outline(numbers, outward / np.linalg.norm(outward, axis=0))


def outwardness(normals: Float32Array, rim: Outline) -> float | None:
    """Mean cosine between outward directions and the image-plane part of normals (3, N); none: the rim is too short."""
    if len(rim.numbers) < photometry.SETTINGS.min_sample:
        return None
    return float(np.mean(np.sum(normals[:2, rim.numbers] * rim.outward, axis=0)))


def integrable_axes(pixels: Pixels, normals: Float32Array) -> tuple[Axes, Axes]:
    """The pair of opposite axes under which normals (3, N), view frame, have the least circulation.

    Sum over the cells of four neighbouring pixels, which are the same under all axes, of the circulation's arctangent
    in slopes a pixel: a crease, round which any normals circulate, counts no more than 90°.
    """
    slope = -normals[:2] / np.maximum(normals[2], np.float32(photometry.SETTINGS.min_view_cosine))
    image = pixels.image(slope.astype(np.float32), np.nan)

    def circulation(axes: Axes) -> float:
        p, q = np.einsum("ab,bhw->ahw", np.array(axes, np.float32), image)
        upward = p[:-1, :-1] + p[:-1, 1:] - p[1:, :-1] - p[1:, 1:]
        rightward = q[:-1, 1:] + q[1:, 1:] - q[:-1, :-1] - q[1:, :-1]
        return float(np.nansum(np.arctan(np.abs(upward - rightward) / 2)))

    return min(OPPOSITE_AXES, key=lambda pair: circulation(pair[0]))


def transformed(lamps: Float32Array, axes: Axes) -> Float32Array:
    """Lamps (F, 6) with the image-plane axes of positions and optical axes transformed."""
    out = lamps.copy()
    matrix = np.array(axes, np.float32)
    out[:, 0:2], out[:, 3:5] = lamps[:, 0:2] @ matrix.T, lamps[:, 3:5] @ matrix.T
    return out


@dataclass(frozen=True)
class Swap:
    """Two images (numbers) whose lamps explain the images best when exchanged, and the residual after, over before."""

    first: int
    second: int
    residual_share: float


def swapped_pair(pixels: Pixels, depth_m: Float32Array, lamps: Float32Array, calibration: Calibration) -> Swap:
    """The pair of lamps whose exchange lowers the least-squares residual most, of all pairs.

    Median over K pixels at depth (K,) of the residual's share of the values.
    """
    chosen = np.linspace(0, len(pixels.index) - 1, min(MAX_SWAP_PIXELS, len(pixels.index))).astype(int)
    few = pixels.subset(np.unique(chosen))
    light = photometry.light_vectors(photometry.points(few.ray, depth_m[np.unique(chosen)]), lamps, calibration)
    rows = light.transpose(2, 0, 1).astype(np.float64)  # (K, F, 3)
    values = few.values.T.astype(np.float64)
    used = (values > SolveSettings().shadow_threshold * np.max(values, axis=1, keepdims=True)) & ~few.clipped.T
    before = _residual(rows, values, used)
    best = min(
        (
            Swap(a, b, _residual(rows[:, order], values, used) / before)
            for a, b, order in (_exchanged(len(lamps), *pair) for pair in combinations(range(len(lamps)), 2))
        ),
        key=lambda swap: swap.residual_share,
    )
    return best


def _exchanged(count: int, a: int, b: int) -> tuple[int, int, np.ndarray]:
    order = np.arange(count)
    order[[a, b]] = b, a
    return a, b, order


def _residual(rows: FloatArray, values: FloatArray, used: BoolArray) -> float:
    """Median over pixels of the rms residual of least squares over the rms value; rows (K, F, 3), values (K, F)."""
    weighted = rows * used[:, :, None]
    matrix = np.einsum("kfa,kfb->kab", weighted, rows)
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2) + 1e-15)[:, None, None] * np.eye(3)
    g = np.linalg.solve(matrix, np.einsum("kfa,kf->ka", weighted, values)[:, :, None])[:, :, 0]
    residual = (values - np.einsum("kfa,ka->kf", rows, g)) * used
    enough = np.count_nonzero(used, axis=1) >= 4
    if not np.any(enough):
        return 1.0
    return float(np.median(np.sum(residual[enough] ** 2, axis=1) / np.sum((values * used)[enough] ** 2, axis=1)) ** 0.5)
