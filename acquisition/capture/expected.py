"""Registration of a frame to the image that the previous result predicts for its light.

From the second pass on a normal map exists, which predicts the frame under each planned light. A frame whose shading
fits only with a shift shows that the object (or the camera) has moved since the pilot. The shift is estimated on lit
pixels inside the silhouette, so that shadows on the table and the silhouette itself have no influence.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError

COMPARISON_WIDTH_PX = 256
"""Width, px, at which images are compared: it resolves the shifts that matter and takes a few milliseconds."""
MAX_SHIFT_PX = 1.0
"""Largest accepted shift, px of the small image (at 256: 0.8 mm of a field of 200 mm)."""
MIN_EXPLAINED_SHARE = 0.25
"""Least fraction of the misfit that a true shift explains; below it, a shift is not significant. In simulated frames of
all six objects it is at most 0.1 at rest, and 0.3 or more when they are shifted by 2.5 pixels of the small image,
except where shadows cover half of the object."""
LIT_THRESHOLD = 0.15
"""Fraction of the brightest pixels' level; darker pixels may lie in cast shadows, which are not predicted."""
MIN_PIXELS = 60
ITERATIONS = 6
TUKEY_HALF_WIDTH = 2.5


def encode_image(picture: FloatArray) -> bytes:
    """Encodes an image (H, W) as a small 16-bit PNG whose brightest pixel is 65535."""
    scale = min(1.0, COMPARISON_WIDTH_PX / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".png", np.round(65535 * small / max(float(small.max()), 1e-12)).astype(np.uint16))[1].tobytes()


def decode_image(content: bytes) -> FloatArray:
    """Decodes a predicted image (h, w), up to scale. Raises RigError store.corrupt."""
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise RigError(ErrorCode.STORE_CORRUPT, "a predicted image is damaged")
    return np.asarray(picture, dtype=np.float64)


@dataclass(frozen=True)
class Displacement:
    """Shift of a frame from its prediction, and the fraction of the misfit that the shift explains (0–1)."""

    shift_px: float  # of the frame
    explained: float
    moved: bool


def displacement(
    predicted: FloatArray, pixels: npt.NDArray[np.uint16] | Float32Array, black: float, full: float
) -> Displacement | None:
    """Registers a frame (H, W) to its prediction (h, w), at most as large, by gradients (Lucas and Kanade 1981).

    Robust least squares with Tukey's biweight rejects cast shadows and highlights; brightness and a uniform ambient
    light are estimated, too. Returns None if no shift can be estimated, or if a large one is not significant.
    """
    size = (predicted.shape[1], predicted.shape[0])
    observed = cv2.resize(pixels.astype(np.float64) - black, size, interpolation=cv2.INTER_AREA)
    bright = float(np.percentile(predicted[predicted > 0], 99)) if np.any(predicted > 0) else 0.0
    inside = cv2.erode((predicted > LIT_THRESHOLD * bright).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    inside &= observed < 0.98 * (full - black)
    if bright == 0 or np.count_nonzero(inside) < MIN_PIXELS:
        return None
    picture, smooth = (np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.float64) for image in (predicted, observed))
    values = smooth[inside]
    at_rest = _robust(_basis(picture, inside)[:, :2], values)
    shift, fit = np.zeros(2), at_rest
    for _ in range(ITERATIONS):
        translation = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        moved = np.asarray(cv2.warpAffine(picture, translation, size, flags=cv2.INTER_CUBIC), np.float64)
        fit = _robust(_basis(moved, inside), values)
        if fit is None or fit.coefficients[0] <= 0:
            return None
        step = fit.coefficients[2:] / fit.coefficients[0]
        shift += np.clip(step, -1.5, 1.5)
        if np.abs(step).max() < 0.01:
            break
    if at_rest is None or fit is None:
        return None
    explained = 1.0 - fit.scale / max(at_rest.scale, 1e-12)
    length_px = float(np.linalg.norm(shift))
    if length_px > MAX_SHIFT_PX and explained <= MIN_EXPLAINED_SHARE:
        return None
    return Displacement(length_px * pixels.shape[1] / size[0], explained, length_px > MAX_SHIFT_PX)


def _basis(picture: FloatArray, inside: BoolArray) -> FloatArray:
    """Returns the design matrix (K, 4): the image, a constant, and derivatives by shifts of one px across and down."""
    slopes = [np.asarray(cv2.Sobel(picture, cv2.CV_64F, *o, ksize=3, scale=1 / 8)) for o in ((1, 0), (0, 1))]
    columns = [picture[inside], np.ones(np.count_nonzero(inside)), *(-slope[inside] for slope in slopes)]
    return np.stack(columns, axis=1).astype(np.float64)


@dataclass(frozen=True)
class _Fit:
    coefficients: FloatArray
    scale: float


def _robust(basis: FloatArray, values: FloatArray) -> _Fit | None:
    """Solves by iteratively reweighted least squares with Tukey's biweight; None if the gradients are degenerate."""
    weights = np.ones(len(values))
    fit: _Fit | None = None
    for _ in range(4):
        normal = basis.T @ (weights[:, None] * basis)
        size = np.sqrt(np.diag(normal) + 1e-300)
        if np.linalg.cond(normal / np.outer(size, size)) > 1e6:
            return None
        coefficients = np.asarray(np.linalg.solve(normal, basis.T @ (weights * values)), np.float64)
        residual = values - basis @ coefficients
        fit = _Fit(coefficients, 1.4826 * float(np.median(np.abs(residual))))
        weights = np.clip(1 - (residual / (2 * TUKEY_HALF_WIDTH * fit.scale + 1e-12)) ** 2, 0, None) ** 2
    return fit
