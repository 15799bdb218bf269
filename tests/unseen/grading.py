"""Grades of a normal map against the truth, and the plain least squares with which it is compared."""

import numpy as np

from acquisition import photometry
from acquisition.models.calibration import Calibration
from acquisition.models.result import NormalMap
from acquisition.normals import Images
from tests.unseen.scenes import GRADINGS, Truth

UNSOLVED_DEG = 90.0


def errors(normals: np.ndarray, mask: np.ndarray, true: Truth) -> dict[str, float]:
    """Mean, median and 95th percentile of the error in each grading; a pixel without a normal counts as 90°."""
    error = np.where(mask, true.error_deg(normals), UNSOLVED_DEG)
    out: dict[str, float] = {}
    for name in GRADINGS:
        values = error[getattr(true, name)]
        if len(values):
            median, p95 = np.percentile(values, [50, 95])
            out |= {f"{name}.mean": float(np.mean(values)), f"{name}.median": float(median), f"{name}.p95": float(p95)}
    return out


def sigma(normal_map: NormalMap, true: Truth) -> dict[str, float]:
    """Compares σ with the error: P(e < σ), P(e < 2σ) and rms e/σ over pixels within 78° that are not doubtful, and
    (`.all`) over all solved pixels of the object; mean σ and error, shares of doubtful and solved pixels within 78°."""
    error, s = true.error_deg(normal_map.normals), normal_map.sigma_deg
    doubtful = normal_map.doubtful
    known = normal_map.mask & np.isfinite(s) & (s > 0)
    out: dict[str, float] = {}
    for suffix, where in (("", known & true.within_78_deg & ~doubtful), (".all", known & true.object)):
        ratio = error[where] / s[where]
        if len(ratio):
            out |= {
                f"within_1{suffix}": float(np.mean(ratio < 1)),
                f"within_2{suffix}": float(np.mean(ratio < 2)),
                f"rms{suffix}": float(np.sqrt(np.mean(ratio**2))),
            }
    graded = known & true.within_78_deg
    return out | {
        "sigma_mean": float(np.mean(s[graded])) if graded.any() else float("nan"),
        "found_mean": float(np.mean(error[graded])) if graded.any() else float("nan"),
        "doubtful": float(np.mean(doubtful[true.within_78_deg])),
        "solved": float(np.mean(normal_map.mask[true.within_78_deg])),
    }


def least_squares(stack: Images, known: Calibration, depth_m: float, mask: np.ndarray) -> np.ndarray:
    """Estimates normals (H, W, 3) by plain near-light least squares over all images, for a flat object at `depth_m`."""
    rays = photometry.rays(known, stack.rows, stack.columns)[:, mask]
    point = photometry.points(rays, np.full(rays.shape[1], depth_m, np.float32))
    light = photometry.light_vectors(point, photometry.lamps(stack.lights), known).astype(float)
    gram = np.einsum("fap,fbp->pab", light, light) + 1e-9 * np.eye(3)
    right = np.einsum("fap,fp->pa", light, stack.whole.values[:, mask])
    g = np.linalg.solve(gram, right[..., None])[..., 0]
    out = np.zeros((*mask.shape, 3))
    out[mask] = g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)
    return out
