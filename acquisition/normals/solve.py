"""Near-light photometric stereo from images to a normal map: window, mask, alternation, final solve.

The solver works on one block of rows at a time, however many images there are. Quantities that distant pixels share are
estimated on a coarse grid, whose block means are gathered block by block. The images are therefore read two or three
times: for the silhouette if it is not given, for the coarse grid, and for the final solve.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import image_values, mosaic, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.models.tuned import tuned
from acquisition.normals import alternation, final_solve, pixel_solution, pyramid
from acquisition.normals.alternatives import model_selection
from acquisition.normals.alternatives.model_trial import Hypothesis
from acquisition.normals.block_solve import BlockMap
from acquisition.normals.images import colour_albedo, session_images, silhouette
from acquisition.normals.images import grey_tile as grey_tiles
from acquisition.normals.images.grey_tile import GreyTile
from acquisition.normals.images.image_set import refuse_coplanar
from acquisition.normals.images.normalised_images import Images, refuse_few
from acquisition.normals.indirect_light import translucency
from acquisition.normals.pixels import resampling
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages
from acquisition.normals.uncertainty import sensor_estimate


@dataclass(frozen=True)
class SolveCheckSettings:
    """Tuned number of the check that there is an object to solve."""

    min_pixels: int = tuned(16, "pixels")
    """Least number of object pixels; with fewer the solve is refused. Measured: the cap of a purely specular ball, 32
    pixels, has a median error below 1.5° (`test_solve_purely_specular_surface_recovers_normals`)."""


SETTINGS = SolveCheckSettings()


@dataclass(frozen=True)
class ObjectPlace:
    """Position of the object as known before its images; maps (H, W) have the calibration's size.

    `depth_m` is its rough depth along OpenCV's z, a number or a map, and may be wrong by 30 mm. `region` is where the
    object can be; none: the whole image. `silhouette` are the pixels that show it; none: they are segmented in the
    images, within the region. `table_depth_m` is the depth of the table below it; none: nothing there reflects light.
    """

    depth_m: float | Float32Array
    region: BoolArray | None = None
    silhouette: BoolArray | None = None
    table_depth_m: Float32Array | None = None


def solve(
    observations: Observations,
    calibration: Calibration,
    settings: SolveSettings,
    place: ObjectPlace,
    *,
    grey_tile: GreyTile | None = None,
    block_map: BlockMap = map,
) -> NormalMap:
    """Solves the images of a session by near-light photometric stereo.

    Gain and read noise are first estimated from repeated and lamp-off frames; if too few, the calibration's values
    stay. `grey_tile`, if there is one, gives the lamp intensity of each image, and its σ replaces the calibration's.
    `block_map` solves the blocks of the final solve, by default one after another in this process. Raises RigError
    normals.infeasible if fewer than three lights are usable, lights are parallel or in a plane, or nothing is lit.
    """
    rows, columns = _window(place.region, calibration.height, calibration.width)
    sensor = sensor_estimate.estimate(observations, calibration, rows, columns)
    known = sensor.calibration
    shown = None if grey_tile is None else grey_tiles.measure(observations, known, grey_tile)
    log_intensity = None
    if shown is not None:
        log_intensity, known = shown.log_intensity, known.model_copy(update={"intensity_sigma": shown.sigma})
    images = session_images.read(observations, known, rows, columns, log_intensity)
    normal_map = solve_stack(
        images, known, settings, place,
        common_lamp_errors_m=session_images.common_lamp_errors(observations, calibration), block_map=block_map,
    )  # fmt: skip
    normal_map = replace(
        normal_map, noise=normal_map.noise | sensor.figures, notes=normal_map.notes | {"sensor": sensor.note}
    )
    if shown is not None:
        normal_map = replace(
            normal_map,
            intensity_factors=normal_map.intensity_factors * np.exp(shown.log_intensity),
            noise=normal_map.noise | shown.figures,
        )
    finding = None if grey_tile is None else grey_tiles.unusable() if shown is None else shown.finding
    return normal_map if finding is None else replace(normal_map, findings=(*normal_map.findings, finding))


def solve_stack(
    images: Images,
    calibration: Calibration,
    settings: SolveSettings,
    place: ObjectPlace,
    *,
    common_lamp_errors_m: FloatArray | None = None,
    thorough: bool = True,
    block_map: BlockMap = map,
) -> NormalMap:
    """Solves images of any source within their window by near-light photometric stereo.

    `common_lamp_errors_m` (F, 3, C) are those of `lamp_pose.common_errors`; `thorough` is explained in `Hypothesis`.
    Other arguments, and errors that are raised, are those of `solve`.
    """
    rows, columns = images.rows, images.columns
    size = (calibration.height, calibration.width)
    refuse_few(len(images.lights))
    inside = np.ones((rows.stop - rows.start, columns.stop - columns.start), np.bool_)
    inside = inside if place.region is None else place.region[rows, columns]
    rough = np.broadcast_to(np.asarray(place.depth_m, np.float32), size)[rows, columns]
    lamps = photometry.lamps(images.lights)
    known = None if place.silhouette is None else place.silhouette[rows, columns] & inside
    channel = mosaic.of_calibration(calibration, rows, columns)
    masked = MaskedImages(
        images, inside if known is None else known, photometry.rays(calibration, rows, columns), channel
    )
    centroid = _centroid(masked, rough)
    refuse_coplanar(lamps[:, :3] - centroid)
    distance = float(np.mean(np.linalg.norm(lamps[:, :3] - centroid, axis=1)))
    noise = image_values.model_noise(calibration, images.shot, images.floor, distance)

    if known is None:
        mask = silhouette.segment(pyramid.albedo_bound(masked, rough, lamps, calibration), inside)
        masked = replace(masked, mask=mask)
    count = int(np.count_nonzero(masked.mask))
    if count < SETTINGS.min_pixels or any(one.stop - one.start == 1 for one in photometry.bounding_box(masked.mask)):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "no object was found in the region: check where it stands")
    factor = alternation.coarse_factor(count, 1 if channel is None else mosaic.CELL)
    table = None
    if place.table_depth_m is not None:
        table = resampling.block_means(place.table_depth_m[rows, columns], factor)
    level = masked.level(factor, pixel_solution.noise_sample(count), table)
    start = rough[masked.mask]
    if factor > 1:
        start = np.full(len(level.coarse.index), np.mean(start), np.float32)
    nominal = Scene(lamps, calibration, noise, settings, common_lamp_errors_m=common_lamp_errors_m)
    solution, findings = model_selection.select(Hypothesis(masked, level, start, nominal, thorough=thorough))
    chosen = solution.hypothesis
    normal_map = final_solve.solve(
        chosen.masked, chosen.level, solution.state, solution.scene, size,
        capture_sigma_deg=photometry.capture_sigma_deg(findings), sharpened=translucency.KIND in chosen.corrected,
        block_map=block_map,
    )  # fmt: skip
    return replace(
        colour_albedo.of_sites(normal_map, calibration),
        intensity_factors=normal_map.intensity_factors * chosen.factors,
        fit=solution.fit.summary(),
        findings=tuple(findings),
    )


def _window(region: BoolArray | None, height: int, width: int) -> tuple[slice, slice]:
    """Returns the bounding box of the region, rows and columns; without a region the whole image."""
    if region is None:
        return slice(0, height), slice(0, width)
    if region.shape != (height, width) or not np.any(region):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "the region is empty, or its size is not the image's: draw it round the object",
        )
    return photometry.bounding_box(region)


def _centroid(masked: MaskedImages, depth_m: Float32Array) -> Float32Array:
    """Returns the mean (3,) of the object's points at a depth (h, w)."""
    if not np.any(masked.mask):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the mask of the object is empty: draw it round the object")
    total = np.zeros(3)
    for rows in masked.blocks():
        mask, depth = masked.mask[rows], depth_m[rows]
        if not np.all(np.isfinite(depth)) or np.any(depth <= 0):
            raise RigError(ErrorCode.NORMALS_INFEASIBLE, "the rough depth must be positive: check base_from_camera")
        total += np.sum(photometry.points(masked.ray[:, rows][:, mask], depth[mask]), axis=1, dtype=np.float64)
    return (total / np.count_nonzero(masked.mask)).astype(np.float32)
