"""White balance and colour matrix from images of a 24-patch chart under the lamp.

The matrix maps the values of a mosaic's (or an RGB camera's) channels to linear sRGB. A lamp near the chart lights it
unevenly, by a factor that is smooth over the chart and common to the channels. Its logarithm is a second-order
polynomial for each image, estimated together with the matrix. Least squares in linear values give the start, from which
the sum of the cubes of CIEDE2000 is minimised: squares alone leave larger errors at single patches, and linear values
give the dark patches no weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from acquisition import colour, mosaic
from acquisition.calibrate.chart_reference import COLUMNS, NEUTRALS, ROWS, ChartReference
from acquisition.models.base import FloatArray
from acquisition.models.colour import ColourCalibration, Mosaic
from acquisition.models.errors import ErrorCode, RigError

DICTIONARY = "DICT_4X4_50"
MARKER_PLACES = ((-1.0, -1.0), (6.0, -1.0), (6.0, 4.0), (-1.0, 4.0))
"""Centres of the frame's markers 0–3, in patches: the upper left patch's centre is (0, 0), the lower right's (5, 3)."""

CORNER_PATCHES = ((0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0))
"""Centres of the corner patches: dark skin, bluish green, black, white."""

SAMPLED_SHARE = 0.5
"""Side of the part of a patch that is read, relative to the distance of patches: excludes gaps and blurred edges."""

MIN_PATCH_PX = 6
"""Least side of that part, pixels: nine sites of red and of blue."""

SHADING_SIGMA = 0.5
"""1 σ of each term of the shading's logarithm at the chart's edge."""

MIN_SIGNAL = 1e-5
"""Least value of a patch, as a fraction of full scale, and least linear value in a logarithm."""

MAX_NEUTRAL_DELTA_E = 6.0
"""Mean CIEDE2000 of the neutral patches above which the chart counts as misplaced or its corners as out of order."""

POWER = 1.5
"""Power of CIEDE2000 in the residuals; least squares then sum the cubes."""


@dataclass(frozen=True)
class ChartFit:
    """Colour calibration; CIELAB of the patches (I, 24, 3) in each image; CIEDE2000 (24,) of their mean over the
    images; logarithms of the shading (I, 24)."""

    calibration: ColourCalibration
    lab: FloatArray
    delta_e: FloatArray
    shading: FloatArray


def locate(picture: np.ndarray) -> FloatArray:
    """Returns the homography (3, 3) from patches to pixels by the four markers round the chart.

    `picture` (H, W) has any depth. Raises RigError calibration.target_not_seen naming the markers that are missing.
    """
    bright = max(float(np.percentile(picture, 99.5)), 1e-9)
    grey = np.clip(255 * picture / bright, 0, 255).astype(np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    parameters = cv2.aruco.DetectorParameters()
    # A mosaic blurs the edges of small markers: only the middles of their bits count.
    parameters.perspectiveRemoveIgnoredMarginPerCell, parameters.maxErroneousBitsInBorderRate = 0.3, 0.5
    parameters.adaptiveThreshWinSizeMax, parameters.minMarkerPerimeterRate = 43, 0.02
    found, numbers, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    # OpenCV returns None if nothing is seen, which its types do not state.
    known = np.ravel(np.asarray(numbers)).tolist() if len(found) else []
    seen = dict(zip(known, found, strict=True))
    missing = [str(number) for number in range(4) if number not in seen]
    if missing:
        raise RigError(
            ErrorCode.CALIBRATION_TARGET_NOT_SEEN,
            f"the chart's markers {', '.join(missing)} are not seen: lay the chart into its frame, or give the centres "
            "of its corner patches as --corners",
        )
    centres = np.array([_crossing(np.asarray(seen[number], np.float64).reshape(4, 2)) for number in range(4)])
    return homography(centres, MARKER_PLACES)


def homography(pixels: FloatArray, places: Sequence[tuple[float, float]] = CORNER_PATCHES) -> FloatArray:
    """Homography (3, 3) from patches to pixels by four points (4, 2), column and row, of `places`. Raises RigError
    calibration.infeasible if they are no quadrilateral in this order."""
    corners = np.asarray(pixels, dtype=np.float32).reshape(-1, 1, 2)
    if len(corners) != 4 or not cv2.isContourConvex(corners.astype(np.int32)):
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "the chart's corners form no quadrilateral: give dark skin, bluish green, black, white, in this order",
        )
    matrix = cv2.getPerspectiveTransform(np.array(places, np.float32), corners.reshape(4, 2))
    return np.asarray(matrix, np.float64)


def values(
    image: FloatArray, matrix: FloatArray, pattern: Mosaic | None, clipped_from: float, names: Sequence[str]
) -> FloatArray:
    """Mean values (24, 3) of R, G, B over the patches' middles, of an image (H, W) of a mosaic or (H, W, 3).

    `matrix` is that of `locate`. Raises RigError calibration.infeasible naming a patch that is clipped, too small or
    outside the image.
    """
    height, width = image.shape[:2]
    whole = slice(0, height), slice(0, width)
    sites = None if pattern is None else mosaic.sites(pattern, *whole)
    half, out = SAMPLED_SHARE / 2, np.zeros((COLUMNS * ROWS, 3))
    for number, name in enumerate(names):
        row, column = divmod(number, COLUMNS)
        square = np.array([[column + a * half, row + b * half] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        corners = cv2.perspectiveTransform(square.reshape(-1, 1, 2), matrix).reshape(4, 2)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        if sides.min() < MIN_PATCH_PX:
            raise RigError(
                ErrorCode.CALIBRATION_INFEASIBLE,
                f"the middle of patch {name} is {sides.min():.0f} pixels wide, too few: move the chart closer",
            )
        if corners.min() < 0 or (corners > (width - 1, height - 1)).any():
            raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, f"patch {name} is not in the image: move the chart")
        inside = np.zeros((height, width), np.uint8)
        cv2.fillConvexPoly(inside, np.round(corners).astype(np.int32), (1,))
        where = inside > 0
        if np.any(image[where] >= clipped_from):
            raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, f"patch {name} is saturated: expose for a shorter time")
        for channel in range(3):
            chosen = image[where][:, channel] if sites is None else image[where & (sites == channel)]
            out[number, channel] = float(np.mean(chosen))
    return out


def fit(signals: FloatArray, reference: ChartReference) -> ChartFit:
    """Fits white balance, matrix and each image's shading to `signals` (I, 24, 3), values above black.

    Raises RigError calibration.infeasible if patches are black or the neutral ones do not come out neutral.
    """
    wanted = colour.srgb_from_lab(reference.lab)
    if signals[:, list(NEUTRALS)[:5]].min() <= MIN_SIGNAL:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE, "neutral patches are black: was the lamp on? Expose for a longer time"
        )
    count = len(signals)
    scale = signals[:, NEUTRALS[0]].mean(axis=1)
    relative = signals / scale[:, None, None]
    first = np.linalg.lstsq(relative.reshape(-1, 3), np.tile(wanted, (count, 1)), rcond=None)[0].T
    terms = _shading_terms()
    start = np.concatenate([first.ravel(), np.zeros(count * terms.shape[1])])
    # The matrix contains the first image's exposure; the others have factors of their own.
    gains = np.zeros(count - 1)

    def lab_of(state: FloatArray) -> tuple[FloatArray, FloatArray]:
        matrix = state[:9].reshape(3, 3)
        shading = state[9 : 9 + count * terms.shape[1]].reshape(count, -1) @ terms.T
        shading = shading + np.concatenate([[0.0], state[9 + count * terms.shape[1] :]])[:, None]
        return colour.lab_from_srgb((relative * np.exp(-shading)[..., None]) @ matrix.T), shading

    def residuals(state: FloatArray) -> FloatArray:
        lab, _ = lab_of(state)
        difference = colour.delta_e_2000(lab, np.broadcast_to(reference.lab, lab.shape))
        return np.concatenate([difference.ravel() ** POWER, state[9:] / SHADING_SIGMA])

    solved = least_squares(residuals, np.concatenate([start, gains]), x_scale="jac", max_nfev=40)
    lab, shading = lab_of(solved.x)
    delta_e = colour.delta_e_2000(lab.mean(axis=0), reference.lab)
    if float(delta_e[list(NEUTRALS)].mean()) > MAX_NEUTRAL_DELTA_E:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"the neutral patches differ from the reference by {delta_e[list(NEUTRALS)].mean():.0f} ΔE: are the "
            "corners in order, and do the reference values belong to this chart?",
        )
    matrix = solved.x[:9].reshape(3, 3)
    white = np.linalg.solve(matrix, np.ones(3))
    shares = np.array([0.25, 0.5, 0.25])
    balanced = matrix * white
    calibration = ColourCalibration.model_validate(
        {
            "white": (white / (shares @ white)).tolist(),
            "matrix": balanced.tolist(),
            "delta_e_mean": float(delta_e.mean()),
            "delta_e_max": float(delta_e.max()),
            "chart": reference.source,
        }
    )
    return ChartFit(calibration, lab, delta_e, shading)


def held_out_delta_e(signals: FloatArray, reference: ChartReference) -> float | None:
    """Mean CIEDE2000 of each image with the matrix of the others, only its own shading fitted; None for one image."""
    if len(signals) < 2:
        return None
    found: list[float] = []
    for number in range(len(signals)):
        others = fit(np.delete(signals, number, axis=0), reference).calibration
        matrix = np.array(others.matrix) / np.array(others.white)
        found.append(float(_shaded_delta_e(signals[number], matrix, reference).mean()))
    return float(np.mean(found))


def _shaded_delta_e(signal: FloatArray, matrix: FloatArray, reference: ChartReference) -> FloatArray:
    """CIEDE2000 (24,) of an image with a known matrix and the best-fitting shading and exposure."""
    terms = np.concatenate([_shading_terms(), np.ones((COLUMNS * ROWS, 1))], axis=1)
    linear = signal @ matrix.T
    luminance = np.maximum(linear @ colour.XYZ_D50_FROM_SRGB[1], MIN_SIGNAL)
    wanted = np.maximum(colour.srgb_from_lab(reference.lab) @ colour.XYZ_D50_FROM_SRGB[1], MIN_SIGNAL)
    start = np.linalg.lstsq(terms, np.log(luminance / wanted), rcond=None)[0]

    def difference(state: FloatArray) -> FloatArray:
        lab = colour.lab_from_srgb(linear * np.exp(-(terms @ state))[:, None])
        return colour.delta_e_2000(lab, reference.lab)

    return difference(least_squares(difference, start).x)


def _shading_terms() -> FloatArray:
    """Terms (24, 5) of the shading's logarithm at the patches: u, v, u², u v, v², ±1 at the edges of the longer side,
    with their means subtracted."""
    row, column = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    half = (COLUMNS - 1) / 2
    u, v = (column - half) / half, (row - (ROWS - 1) / 2) / half
    terms = np.stack([u, v, u * u, u * v, v * v], axis=1)
    return terms - terms.mean(axis=0)


def _crossing(corners: FloatArray) -> FloatArray:
    """Crossing (2,) of a quadrilateral's diagonals (4, 2): the image of a square's centre."""
    (a, b, c, d) = corners
    along, across = c - a, d - b
    share = np.linalg.solve(np.stack([along, -across], axis=1), b - a)
    return a + share[0] * along
