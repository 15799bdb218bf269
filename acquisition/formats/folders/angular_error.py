"""Angular error of a normal map against the ground truth of a folder."""

from dataclasses import dataclass

import numpy as np

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import MEDIAN_ERROR_PER_SIGMA, NormalMap
from acquisition.normals.images.image_set import ImageSet


@dataclass(frozen=True)
class AngularErrors:
    """Angular errors in degrees over `pixels` graded pixels. `coverage` is their share of those that could be graded.

    `sigma_ratio` is the median error divided by the median that σ predicts (ideally 1); None: there is no σ.
    """

    mean_deg: float
    median_deg: float
    p95_deg: float
    pixels: int
    coverage: float
    sigma_ratio: float | None


def angular_errors(normal_map: NormalMap, images: ImageSet) -> AngularErrors | None:
    """Angular errors of a result within the evaluation mask (default: the mask) where truth is known; None: no truth.

    Raises RigError normals.infeasible when no such pixel has a normal.
    """
    if images.truth is None:
        return None
    asked = images.mask if images.evaluation_mask is None else images.evaluation_mask
    known = asked & (np.linalg.norm(images.truth, axis=-1) > 0.5)
    graded = known & normal_map.mask
    if not np.any(graded):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no pixel of the evaluation mask has a normal: check the masks")
    estimated, true = normal_map.normals[graded].astype(np.float64), images.truth[graded].astype(np.float64)
    sine, cosine = np.linalg.norm(np.cross(estimated, true), axis=-1), np.sum(estimated * true, axis=-1)
    error = np.degrees(np.arctan2(sine, cosine))  # exact for small angles, where the arccosine is not
    sigma = normal_map.sigma_deg[graded & np.isfinite(normal_map.sigma_deg)]
    predicted = MEDIAN_ERROR_PER_SIGMA * float(np.median(sigma)) if sigma.size else 0.0
    return AngularErrors(
        mean_deg=float(np.mean(error)),
        median_deg=float(np.median(error)),
        p95_deg=float(np.percentile(error, 95)),
        pixels=int(np.count_nonzero(graded)),
        coverage=float(np.count_nonzero(graded) / np.count_nonzero(known)),
        sigma_ratio=float(np.median(error)) / predicted if predicted > 0 else None,
    )
