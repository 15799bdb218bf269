"""The highlight on a mirror sphere: the brightest spot of an image, and whether it can be the lamp's mirror image.

Every image has a brightest spot: the table in a long exposure, or a window's mirror image while the lamp is off. A
sphere of radius R images the lamp's window at R/2 whatever its size, so that the light of the spot depends on the
sphere and on the illuminance E alone:

    sum of values = π p (R f / 2z)²,   p the value of white paper in the sphere's place,   f/z pixels per metre,

times the mirror's reflectance; under oblique incidence the two focal lengths' product is R²/4 as well. The lamp's
mirror image is distinguished from other spots by its light, extent and place.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import geometry, lamp_pose, photometry
from acquisition.calibrate import lamp_targets
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.rounding import percent

HIGHLIGHT_SHARE = 0.15
"""Share of the brightest value above the background from which a pixel belongs to the highlight: the values at the rim
determine its middle to fractions of a pixel."""

MIN_CONTRAST = 0.05
"""Least height of a highlight above the background, as a share of full scale."""

NO_HIGHLIGHT = "no highlight: the lamp is off, or the sphere is not in the image"

MIN_HIGHLIGHT_PX, CLIPPED_FROM, MAX_CLIPPED = 4, 0.98, 0.5
"""Least number of pixels of a highlight (fewer are a hot pixel); share of full scale from which a value counts as
clipped; share of clipped pixels above which the highlight's middle is a guess."""

MAX_RIVAL = 0.5
"""Ratio of the brightness sums of the second brightest and the brightest spot above which the image is ambiguous."""

LEAST_LIGHT = 0.1
"""Least light of the spot, as a share of that with a perfect mirror; below it the spot is something else. Steel
reflects half, and a lobe off its axis may be a third of the nominal one."""

PLACE_M = 0.05
"""Largest distance of the spot from the outline of the sphere at its stated place, m: the sphere is placed by hand."""


@dataclass(frozen=True)
class Spot:
    """The brightest spot of an image: its middle (2,), column and row; the sum of its values above the background, in
    fractions of full scale; its longer side, pixels."""

    pixel: FloatArray
    light: float
    side_px: float


def find(image: np.ndarray, full_scale: float) -> Spot | str:
    """Finds the brightest spot, its middle weighted by brightness; returns the reason in words if there is none.

    `image` (H, W), linear; `full_scale` is the value at which the sensor clips.
    """
    values = image.astype(np.float32)
    background, peak = float(np.median(values)), float(values.max())
    if peak - background < MIN_CONTRAST * full_scale:
        return NO_HIGHLIGHT
    threshold = background + HIGHLIGHT_SHARE * (peak - background)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((values >= threshold).astype(np.uint8))
    sums = np.bincount(labels.ravel(), weights=values.ravel(), minlength=count)
    sums[0] = 0
    order = np.argsort(sums)[::-1]
    best = int(order[0])
    if count < 2 or statistics[best, cv2.CC_STAT_AREA] < MIN_HIGHLIGHT_PX:
        return NO_HIGHLIGHT
    if count > 2 and sums[order[1]] > MAX_RIVAL * sums[best]:
        return "several bright spots: cover everything bright or shiny except the sphere"
    inside = labels == best
    if np.mean(values[inside] >= CLIPPED_FROM * full_scale) > MAX_CLIPPED:
        return lamp_targets.CLIPPED_HIGHLIGHT
    row, column = np.nonzero(inside)
    weight = values[inside] - threshold + 1e-6 * threshold
    side = max(statistics[best, cv2.CC_STAT_WIDTH], statistics[best, cv2.CC_STAT_HEIGHT])
    middle = np.array([np.average(column, weights=weight), np.average(row, weights=weight)])
    return Spot(middle, float((values[inside] - background).sum()) / full_scale, float(side))


def find_of_lamp(
    image: np.ndarray, base_from_tool: FloatArray, exposure_s: float, cell: CellConfig, calibration: Calibration
) -> FloatArray | str:
    """Returns the middle (2,), column and row, of the lamp's mirror image in a frame (H, W), or why there is none."""
    spot = find(image, float(2**calibration.sensor.bits - 1))
    if isinstance(spot, str):
        return spot
    expected = expected_spot(base_from_tool, exposure_s, cell, calibration)
    return why_another(spot, expected, _pixels_per_metre(cell, calibration)) or spot.pixel


def expected_spot(base_from_tool: FloatArray, exposure_s: float, cell: CellConfig, calibration: Calibration) -> Spot:
    """Predicts what a perfect mirror sphere shows of the lamp by the calibration in use: the sphere's middle in the
    image, the light of the lamp's mirror image, and the sphere's radius as the largest side of the spot."""
    center = lamp_targets.sphere_center(cell)
    view = geometry.transform(geometry.inverse(lamp_pose.base_from_view(calibration)), center[None])
    lamp = photometry.lamps([lamp_pose.light_from_tool(base_from_tool, calibration)])
    strength = float(np.linalg.norm(photometry.light_vectors(_column(view), lamp, calibration)[0, :, 0]))
    paper = calibration.lamp_intensity * exposure_s * strength
    radius_px = lamp_targets.require_targets(cell).sphere_radius_m * _pixels_per_metre(cell, calibration)
    return Spot(photometry.project(calibration, view)[0], np.pi * paper * (radius_px / 2) ** 2, radius_px)


def why_another(spot: Spot, expected: Spot, pixels_per_metre: float) -> str:
    """Returns why a spot is not the lamp's mirror image, for people; empty if it can be."""
    if spot.side_px > expected.side_px:
        return f"{NO_HIGHLIGHT} (the brightest spot is {spot.side_px:.0f} pixels wide, too wide for the lamp)"
    if spot.light < LEAST_LIGHT * expected.light:
        share = percent(spot.light / expected.light)
        return f"{NO_HIGHLIGHT} (the brightest spot has {share} of the lamp's expected light)"
    away_m = float(np.linalg.norm(spot.pixel - expected.pixel)) / pixels_per_metre
    if away_m > PLACE_M + expected.side_px / pixels_per_metre:
        return f"the brightest spot is {1e3 * away_m:.0f} mm from the sphere's place: lay the sphere in the middle"
    return ""


def _pixels_per_metre(cell: CellConfig, calibration: Calibration) -> float:
    """Returns the pixels per metre across the line of sight at the sphere's place."""
    base_from_camera = np.array(calibration.base_from_camera)
    away = float((lamp_targets.sphere_center(cell) - base_from_camera[:3, 3]) @ base_from_camera[:3, 2])
    return calibration.camera_matrix[0][0] / away


def _column(points: FloatArray) -> Float32Array:
    return np.ascontiguousarray(points.T, dtype=np.float32)
