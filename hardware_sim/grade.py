"""Angular errors of estimated normals against the simulator's true ones; only graders see both.

By default the graded pixels are those whose true normal lies within 78° of the viewing ray, in the object's mask eroded
by one pixel. A narrower grading takes those of them whose footprint shows one surface, a wider one every pixel of the
object. Graded pixels without a normal lower the coverage and do not enter the errors.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tifffile

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim.truth import Truth

MAX_SLANT_DEG = 78.0

Grading = Literal["one_surface", "within_78_deg", "object"]
"""Pixels over which errors are taken: `within_78_deg` as above; `one_surface` those of them whose footprint shows one
smooth surface; `object` all whose centre shows the object, including grazing ones and the silhouette's own."""
GRADINGS: tuple[Grading, ...] = ("one_surface", "within_78_deg", "object")


@dataclass(frozen=True)
class Grade:
    """Angular errors in degrees over the graded pixels that have a normal.

    `found_to_predicted` is the median error divided by 0.833 · the median σ (1 is right); `within_sigma` and
    `within_two_sigma` are the shares of errors below σ and 2 σ (0.632 and 0.982 are right). None where there is no σ.
    """

    mean_deg: float
    median_deg: float
    p95_deg: float
    share_over_10_deg: float
    coverage: float
    graded_pixels: int
    predicted_median_deg: float | None
    found_to_predicted: float | None
    within_sigma: float | None
    within_two_sigma: float | None

    def as_dict(self) -> dict[str, float | int | None]:
        """Names and values, for JSON."""
        return asdict(self)


def viewing_rays(calibration: Calibration) -> FloatArray:
    """Unit vectors (H, W, 3), view frame, from each pixel centre to the camera."""
    x, y = photometry.rays(calibration, slice(0, calibration.height), slice(0, calibration.width)).astype(float)
    rays = np.stack([-x, y, np.ones_like(x)], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def graded_pixels(truth: Truth, calibration: Calibration, grading: Grading = "within_78_deg") -> BoolArray:
    """Mask (H, W) of the graded pixels. Raises RigError request.invalid if the truth lacks `one_surface`."""
    if grading == "object":
        return truth.mask
    inner = cv2.erode(truth.mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    cosine = np.einsum("hwi,hwi->hw", truth.normals, viewing_rays(calibration))
    facing = inner & (cosine > np.cos(np.radians(MAX_SLANT_DEG)))
    if grading == "within_78_deg":
        return facing
    if truth.one_surface is None:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            "the truth file has no `one_surface` mask: choose another grading, or make the file again",
        )
    return facing & truth.one_surface


def error_deg(normals: Float32Array, truth: Truth) -> FloatArray:
    """Angle (H, W) between estimated and true normals, degrees; undefined outside either mask."""
    estimated = normals.astype(float)
    true = truth.normals.astype(float)
    # The arctangent is exact for small angles, where the arccosine is not.
    across = np.linalg.norm(np.cross(estimated, true), axis=-1)
    return np.degrees(np.arctan2(across, np.einsum("hwi,hwi->hw", estimated, true)))


def grade(
    normals: Float32Array,
    mask: BoolArray,
    sigma_deg: Float32Array | None,
    truth: Truth,
    calibration: Calibration,
    grading: Grading = "within_78_deg",
) -> Grade:
    """Grades normals (H, W, 3) in the view frame within `mask` (H, W), with σ (H, W) as in NormalMap or None.

    Raises RigError request.invalid if sizes differ or no pixel can be graded.
    """
    if normals.shape != truth.normals.shape or mask.shape != truth.mask.shape:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"the normals have shape {normals.shape}, but the truth has {truth.normals.shape}",
        )
    graded = graded_pixels(truth, calibration, grading)
    solved = graded & mask & (np.linalg.norm(normals, axis=-1) > 0.5)
    if not solved.any():
        raise RigError(ErrorCode.REQUEST_INVALID, "no graded pixel has a normal")
    errors = error_deg(normals, truth)[solved]
    predicted = ratio = within = within_two = None
    if sigma_deg is not None:
        sigma = sigma_deg[solved].astype(float)
        known = np.isfinite(sigma)
        if known.any():
            predicted = float(0.833 * np.median(sigma[known]))
            ratio = float(np.median(errors[known])) / predicted
            within = float(np.mean(errors[known] < sigma[known]))
            within_two = float(np.mean(errors[known] < 2 * sigma[known]))
    return Grade(
        mean_deg=float(errors.mean()),
        median_deg=float(np.median(errors)),
        p95_deg=float(np.percentile(errors, 95)),
        share_over_10_deg=float(np.mean(errors > 10)),
        coverage=float(solved.sum() / graded.sum()),
        graded_pixels=int(graded.sum()),
        predicted_median_deg=predicted,
        found_to_predicted=ratio,
        within_sigma=within,
        within_two_sigma=within_two,
    )


def grade_folder(results: Path, truth: Truth, calibration: Calibration, grading: Grading = "within_78_deg") -> Grade:
    """Grades a results folder: `normals.tiff`, `mask.png` and, if there, `sigma_deg.tiff`.

    Raises RigError store.corrupt that names a missing or damaged file.
    """
    normals = _tiff(results / "normals.tiff")
    mask = cv2.imread(str(results / "mask.png"), cv2.IMREAD_UNCHANGED)
    if mask is None:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{results / 'mask.png'}: cannot be read", file="mask.png")
    sigma_file = results / "sigma_deg.tiff"
    sigma = _tiff(sigma_file) if sigma_file.exists() else None
    return grade(normals, np.asarray(mask) > 0, sigma, truth, calibration, grading)


def _tiff(path: Path) -> Float32Array:
    try:
        return np.asarray(tifffile.imread(path), dtype=np.float32)
    except (OSError, ValueError) as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path}: cannot be read: {error}", file=path.name) from error
