"""Images to normals: window and mask, the refining loop, the last solve, and the result as a map of the whole frame.

However many images there are, no more than a block of rows is held of them: what a pixel shares with far ones is found
on a coarse grid, whose means are gathered block by block. So the images are looked through two or three times: for the
silhouette where it is not given, for the coarse grid, and for the last solve.
"""

from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals import alternation, final_solve, pyramid, sensor_estimate, session_images, silhouette
from acquisition.normals.final_solve import Scene
from acquisition.normals.pyramid import MaskedImages
from acquisition.normals.session_images import Images

MIN_DIRECTION_SPREAD = 0.05
"""Smallest singular value of the unit light directions (scaled by √F): below, they lie in one plane."""

MIN_PIXELS = 16


def solve(
    observations: Observations,
    calibration: Calibration,
    settings: SolveSettings,
    *,
    initial_depth_m: float | Float32Array,
    region: BoolArray | None = None,
    table_depth_m: Float32Array | None = None,
) -> NormalMap:
    """Solves all images taken so far.

    `initial_depth_m` is the object's rough depth along OpenCV's z (a number or an (H, W) map; 30 mm off is fine);
    `region` (H, W) is where the object can be, none: the whole image; `table_depth_m` (H, W) is the depth of the table
    it stands on, none: it stands on nothing that sends light. The sensor's noise is that of the images themselves where
    they tell it, else the calibration's. Raises RigError normals.infeasible when fewer than three lights are usable,
    the lights are parallel or in one plane, or nothing is lit.
    """
    rows, columns = _window(region, calibration.height, calibration.width)
    shown = sensor_estimate.estimate(observations, calibration, rows, columns)
    images = session_images.read(observations, shown.calibration, rows, columns)
    found = solve_stack(
        images, shown.calibration, settings, initial_depth_m=initial_depth_m, region=region,
        table_depth_m=table_depth_m,
    )  # fmt: skip
    return replace(found, noise=found.noise | shown.figures, notes=found.notes | {"sensor": shown.note})


def solve_stack(
    images: Images,
    calibration: Calibration,
    settings: SolveSettings,
    *,
    initial_depth_m: float | Float32Array,
    region: BoolArray | None = None,
    table_depth_m: Float32Array | None = None,
    object_mask: BoolArray | None = None,
) -> NormalMap:
    """Solves images of any source within their window.

    `object_mask` (H, W) is the object's whole silhouette; none: it is found in the images, within `region`. The rest as
    for `solve`. All (H, W) are of the calibration's size. Raises RigError normals.infeasible as `solve` does.
    """
    rows, columns = images.rows, images.columns
    size = (calibration.height, calibration.width)
    _refuse_few(images)
    inside = np.ones((rows.stop - rows.start, columns.stop - columns.start), np.bool_)
    inside = inside if region is None else region[rows, columns]
    rough = np.broadcast_to(np.asarray(initial_depth_m, np.float32), size)[rows, columns]
    lamp = photometry.lamps(images.lights)
    known = None if object_mask is None else object_mask[rows, columns] & inside
    seen = MaskedImages(images, inside if known is None else known, photometry.rays(calibration, rows, columns))
    middle = _centroid(seen, rough)
    _refuse_coplanar_lights(lamp, middle)
    distance = float(np.mean(np.linalg.norm(lamp[:, :3] - middle, axis=1)))
    noise = photometry.model_noise(calibration, images.shot, images.floor, distance)

    if known is None:
        found = silhouette.segment(pyramid.albedo_bound(seen, rough, lamp, calibration), inside)
        seen = MaskedImages(images, found, seen.ray)
    count = int(np.count_nonzero(seen.mask))
    if count < MIN_PIXELS:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no object was found in the region: check where it stands")
    factor = alternation.coarse_factor(count)
    table = None if table_depth_m is None else table_depth_m[rows, columns]
    gathered = seen.level(factor, final_solve.noise_sample(count), table)
    start = rough[seen.mask]
    if factor > 1:
        start = np.full(len(gathered.coarse.index), np.mean(start), np.float32)
    refined = alternation.refine(gathered.coarse, factor, start, lamp, calibration, noise, settings, gathered.table)
    model = Scene(refined.shared.lamps(lamp), calibration, noise, settings)
    model = final_solve.with_residual_noise(gathered.sample, refined.resampled(gathered.interpolate_sample), model)
    return final_solve.solve(seen, gathered, refined, model, size)


def _refuse_few(images: Images) -> None:
    if len(images.lights) < 3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there are {len(images.lights)} lit images and at least three are needed: take more lights",
            lights=len(images.lights),
        )


def _window(region: BoolArray | None, height: int, width: int) -> tuple[slice, slice]:
    """The bounding box of the region."""
    if region is None:
        return slice(0, height), slice(0, width)
    if region.shape != (height, width) or not np.any(region):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE, "the region is empty or not of the image's size: draw it round the object"
        )
    return silhouette.bounding_box(region)


def _centroid(seen: MaskedImages, depth_m: Float32Array) -> Float32Array:
    """The mean (3,) of the points at a depth (h, w)."""
    if not np.any(seen.mask):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the mask of the object is empty: draw it round the object")
    total = np.zeros(3)
    for rows in seen.blocks():
        mask, depth = seen.mask[rows], depth_m[rows]
        if not np.all(np.isfinite(depth)) or np.any(depth <= 0):
            raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the rough depth must be positive: check base_from_camera")
        total += np.sum(photometry.points(seen.ray[:, rows][:, mask], depth[mask]), axis=1, dtype=np.float64)
    return (total / np.count_nonzero(seen.mask)).astype(np.float32)


def _refuse_coplanar_lights(lamp: Float32Array, middle: Float32Array) -> None:
    offsets = lamp[:, :3] - middle
    units = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    spread = np.linalg.svd(units, compute_uv=False)[-1] / np.sqrt(len(units))
    if not spread > MIN_DIRECTION_SPREAD:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "the lights are parallel or lie in one plane with the object: take lights from other sides",
            spread=float(spread),
        )
