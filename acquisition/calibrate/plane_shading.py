"""Brightness of each patch of the matt plane under each pose of the lamp, as a function of geometry and lobe.

In logarithms it is a sum of four terms: the shading by distance, slant and angle of a lamp of intensity 1 with a cosᵘ
lobe; a spline over the angle off the axis; the lamp's brighter side; the camera's sensitivity over the image.
Calibration (`lamp_lobe`) and check (`lamp_check`) are fits of this one model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import geometry, image_values, photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration

LEAST_AHEAD = 0.2
"""Cosine to the lamp's axis, and to the plane's normal, below which patches are left out."""

SAG_SIGMA_M = 2e-4
"""Prior 1 σ of the plane's sag in its middle along either side, m; seen from above, its border hardly shows it."""

PLACED = 11
"""Number of unknowns of the geometry before those of the placings: lamp, camera, sag."""

STEP = 1e-6
"""Step of numerical derivatives by lengths, m, and angles, rad."""


@dataclass(frozen=True)
class Placing:
    """One pose of the plane: `camera_from_board` (4, 4) and the covariance (6, 6) of a small motion of the board in its
    own frame, m and rad."""

    camera_from_board: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class PlaneImage:
    """Patches of one image: `points` (N, 3) in the board's frame, m; `pixels` (N, 2), column and row; `values` (N,),
    lamp-off frame subtracted, in fractions of full scale per second; `noise` (N,), their 1 σ as a fraction."""

    name: str
    placing: int
    base_from_tool: FloatArray
    points: FloatArray
    pixels: FloatArray
    values: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class Known:
    """Values that the fit takes as given: `calibration` with camera, its pose, and the lamp's; the plane's albedo and
    its 1 σ as a fraction; covariances of `tool_from_lamp`'s position (3, 3) and of `base_from_camera` (6, 6); width and
    height of the board, m."""

    calibration: Calibration
    albedo: float
    albedo_sigma: float
    lamp_covariance: FloatArray
    camera_covariance: FloatArray
    size_m: tuple[float, float]

    def covariances(self, placings: Sequence[Placing]) -> list[FloatArray]:
        """Returns the covariances of all uncertain geometry: lamp, camera, sag, placings."""
        sag = SAG_SIGMA_M**2 * np.eye(2)
        return [self.lamp_covariance, self.camera_covariance, sag, *(placing.covariance for placing in placings)]


@dataclass(frozen=True)
class SeenPatches:
    """Geometry of all patches: angle off the axis (N,), x and y of the direction in the lamp's frame (N, 2), and ln of
    the shading by a lamp of intensity 1 with a cosᵘ lobe (N,)."""

    angle: FloatArray
    side: FloatArray
    log_shading: FloatArray


def seen_patches(
    images: Sequence[PlaneImage], placings: Sequence[Placing], known: Known, off: FloatArray
) -> SeenPatches:
    """Returns the geometry with lamp (3,), camera (6,), sag (2,) and placings (6 each) moved by `off`, m and rad."""
    calibration = known.calibration
    tool_from_lamp = np.array(calibration.tool_from_lamp)
    tool_from_lamp[:3, 3] += off[:3]
    camera = np.array(calibration.base_from_camera) @ geometry.pose(off[3:6], off[6:9])
    moved = [
        camera @ placing.camera_from_board @ geometry.pose(part[:3], part[3:])
        for placing, part in zip(placings, off[PLACED:].reshape(-1, 6), strict=True)
    ]
    angles, sides, shadings = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for image in images:
        board, lamp = moved[image.placing], image.base_from_tool @ tool_from_lamp
        # The board's z points into it. A sag z(u, v) moves it away from the lamp and tilts it by its slope.
        # Half a millimetre of depth dims by 0.2 %, which would otherwise be attributed to the flat field.
        half = np.array(known.size_m) / 2
        across = image.points[:, :2] / half - 1
        depth = (1 - across**2 - _edge_mean(known.size_m)) @ off[9:11]
        slope = -2 * off[9:11] * across / half
        points = image.points + np.stack([0 * depth, 0 * depth, depth], axis=1)
        away = geometry.transform(board, points) - lamp[:3, 3]
        distance = np.linalg.norm(away, axis=1)
        direction = geometry.rotate(geometry.inverse(lamp), away / distance[:, None])
        ahead = np.maximum(direction[:, 2], 1e-3)
        into = np.column_stack([-slope, np.ones(len(slope))]) @ board[:3, :3].T
        facing = np.maximum(np.einsum("ni,ni->n", away, into) / distance, 1e-3)
        angles.append(np.arctan2(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2]))
        sides.append(direction[:, :2])
        fall = 2 * np.log(calibration.reference_m / distance) + calibration.lobe_exponent * np.log(ahead)
        shadings.append(np.log(facing) + fall)
    return SeenPatches(np.concatenate(angles), np.concatenate(sides), np.concatenate(shadings))


def _edge_mean(size_m: tuple[float, float]) -> FloatArray:
    """Mean of 1 − u² and 1 − v² over the board's edge, which determines its pose."""
    width, height = size_m
    return 2 / 3 * np.array([width, height]) / (width + height)


def columns(images: Sequence[PlaneImage], seen: SeenPatches, knots: tuple[float, ...], known: Known) -> FloatArray:
    """Design matrix (N, 1 + K − 1 + 2 + 5): ln intensity, knots but the first, tilt to first order, flat field."""
    pixels = np.concatenate([image.pixels for image in images])
    flat = image_values.flat_terms(pixels, known.calibration.width, known.calibration.height)
    spline = photometry.lobe_spline(knots, seen.angle)[:, 1:]
    return np.hstack([np.ones((len(pixels), 1)), spline, seen.side, flat])


def derivatives(
    images: Sequence[PlaneImage], placings: Sequence[Placing], known: Known, knots: tuple[float, ...],
    lobe: FloatArray, off: FloatArray,
) -> FloatArray:  # fmt: skip
    """Derivatives (N, 11 + 6 G) of ln brightness by the geometry, about `off`; `lobe` (K + 1,) are knots and tilt."""

    def predicted(moved: FloatArray) -> FloatArray:
        seen = seen_patches(images, placings, known, moved)
        spline = photometry.lobe_spline(knots, seen.angle)[:, 1:] @ lobe[:-2]
        return seen.log_shading + spline + np.log(1 + seen.side @ lobe[-2:])

    steps = STEP * np.eye(PLACED + 6 * len(placings))
    return np.stack([(predicted(off + step) - predicted(off - step)) / (2 * STEP) for step in steps], axis=1)


def usable(image: PlaneImage, placing: Placing, calibration: Calibration) -> PlaneImage:
    """Returns the image with only the patches that the lamp lights from ahead, not grazing."""
    base_from_board = np.array(calibration.base_from_camera) @ placing.camera_from_board
    lamp = image.base_from_tool @ np.array(calibration.tool_from_lamp)
    away = geometry.transform(base_from_board, image.points) - lamp[:3, 3]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    good = (away @ lamp[:3, 2] > LEAST_AHEAD) & (away @ base_from_board[:3, 2] > LEAST_AHEAD) & (image.values > 0)
    return selected(image, good)


def selected(image: PlaneImage, good: BoolArray) -> PlaneImage:
    """Returns the image with only the patches `good` (N,)."""
    return replace(
        image, points=image.points[good], pixels=image.pixels[good], values=image.values[good], noise=image.noise[good]
    )
