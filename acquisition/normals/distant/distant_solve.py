"""Distant-light photometric stereo from an image set to a normal map, by blocks of rows.

`auto` selects the solver by cross-validation: each predicts held-out lights at a sample of pixels, and the one with the
least error solves all pixels. Before that the lights' relative intensities are found (`light_intensities`), except for
`ls`, the plain baseline, which takes them as stated; and where the source has no mask, one is proposed (`lit_mask`).
Only one block of the stack is in memory at a time, so that a stack of any size can be
solved; per pixel, only the result is kept.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import HIGHLIGHT, LIT, FisherInformation, NormalMap
from acquisition.models.tuned import tuned
from acquisition.normals import integration, memory_mapped
from acquisition.normals.distant import light_intensities, lit_mask, pixel_blocks, solver_selection, solvers
from acquisition.normals.distant.solvers import Solver
from acquisition.normals.image_set import DistantLights, ImageSet, check

SAMPLE_PIXELS = 900
"""Pixels read in advance: for the check of the images, the choice of solver and the shared diffuse parameters."""


@dataclass(frozen=True)
class DistantSolveSettings:
    """Tuned numbers of the solve under distant light."""

    max_clipped_share: float = tuned(0.95, "share")
    """Share of the sampled pixels that may be clipped; an image with more is refused."""


SETTINGS = DistantSolveSettings()


def solve(images: ImageSet, solver: Solver = "auto", *, with_depth: bool = True, keep_steps: bool = False) -> NormalMap:
    """Solves an image set with DistantLights for normals, albedo, σ and depth; `notes` state the solver and why.

    `intensity_factors` are means over the channels of what the stated intensities were multiplied by; `notes` hold each
    channel's (`intensity_factors`), how they were judged (`intensities`), and whether the mask was `proposed` (`mask`).

    `keep_steps` lets depth jump where normals disagree with their neighbours, see `integration.depth`. Depth is in m
    where a camera and a rough depth are known, else relative (`notes["depth_unit"]`). Raises RigError
    normals.infeasible as `image_set.check` does, and naming the file where an image is black, clipped or not finite.
    """
    check(images)
    lights = images.lights
    if not isinstance(lights, DistantLights):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "these lights are near: solve them as near lights")
    notes: dict[str, Any] = {}
    if not images.mask_given:
        images = replace(images, mask=lit_mask.propose(images))
        notes["mask"] = "proposed"
    directions = pixel_blocks.directions(images)
    values, clipped = pixel_blocks.sample(images, SAMPLE_PIXELS)
    _refuse_unusable(images, values, clipped)
    factors = np.ones((images.count, images.channels))
    if solver != "ls":
        intensities = light_intensities.estimate(*pixel_blocks.sample_channels(images, SAMPLE_PIXELS), directions)
        factors = intensities.factors
        notes["intensities"] = intensities.why
        if np.any(factors != 1):
            notes["intensity_factors"] = np.round(factors, 5).tolist()
            images = replace(images, lights=replace(lights, intensities=lights.intensities * factors))
            values, clipped = pixel_blocks.sample(images, SAMPLE_PIXELS)
    chosen, why = (solver, "as asked")
    if solver == "auto":
        chosen, why = solver_selection.select(values, clipped, directions)
    method, more = solvers.prepare(chosen, values, clipped, directions)
    notes = {"solver": chosen, "why": why} | more | notes
    solved = _solve_blocks(
        images, method, luma=chosen == "ls", notes=notes, with_depth=with_depth, keep_steps=keep_steps
    )
    return replace(solved, intensity_factors=np.exp(np.mean(np.log(factors), axis=1)))


def _refuse_unusable(images: ImageSet, values: Float32Array, clipped: BoolArray) -> None:
    """Refuses images that are not finite, black or clipped at a sample of pixels (K, F).

    Raises RigError normals.infeasible naming the image.
    """
    for index, name in enumerate(images.names):
        column, full = values[:, index], clipped[:, index]
        if not np.all(np.isfinite(column)):
            what = "has values that are not finite: write it again"
        elif np.mean(full) > SETTINGS.max_clipped_share:
            what = "is clipped all over the object: expose it for a shorter time"
        elif not np.any(column > 0):
            what = "is black all over the object: was the lamp on? Leave it out or take it again"
        else:
            continue
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, f"{name} {what}", file=name)


def _solve_blocks(
    images: ImageSet, method: solvers.Method, *, luma: bool, notes: dict[str, Any], with_depth: bool = True,
    keep_steps: bool = False,
) -> NormalMap:  # fmt: skip
    """Solves all blocks of rows by one method into one normal map.

    `luma` as for `pixel_blocks.read`; `notes` go into the NormalMap.
    """
    size = (images.height, images.width)
    normals = np.zeros((*size, 3), np.float32)
    albedo, residual = np.zeros(size, np.float32), np.zeros(size, np.float32)
    colour = np.zeros((*size, 3), np.float32) if images.channels == 3 else None
    sigma = np.full(size, np.nan, np.float32)
    solved, doubtful = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    flags = memory_mapped.zeros((images.count, *size))
    for block in pixel_blocks.iterate(images, luma=luma):
        rows = slice(block.start, block.stop)
        chosen = np.flatnonzero(images.mask[rows])
        result = method(block, chosen)
        good = (result.albedo > 0) & np.all(np.isfinite(result.normals), axis=0)

        def scatter(target: np.ndarray, values: np.ndarray, rows: slice = rows, chosen: np.ndarray = chosen) -> None:
            part = target[rows].reshape(-1, *target.shape[2:])
            part[chosen] = values

        scatter(solved, good)
        scatter(normals, np.where(good[:, None], result.normals.T, 0))
        scatter(albedo, np.where(good, result.albedo, 0))
        scatter(residual, np.where(good, result.residual, 0))
        scatter(sigma, np.where(good, np.degrees(np.sqrt(result.variance)), np.nan))
        scatter(doubtful, np.count_nonzero(result.flags & (LIT | HIGHLIGHT), axis=0) < 3)
        if colour is not None and block.colour is not None:
            scatter(colour, np.where(good[:, None], result.albedo[:, None] * block.colour[chosen], 0))
        part = flags[:, rows].reshape(images.count, -1)
        part[:, chosen] = result.flags
        flags[:, rows] = part.reshape(images.count, rows.stop - rows.start, images.width)
        memory_mapped.release(flags)
    depth, unit = np.zeros(size, np.float32), "none"
    if with_depth:
        depth, unit = _depth(images, normals, solved, sigma, keep_steps)
    return NormalMap(
        normals=normals,
        albedo=albedo,
        depth=depth,
        sigma_deg=sigma,
        residual=residual,
        mask=solved,
        silhouette=images.mask,
        flags=flags,
        intensity_factors=np.ones(images.count),
        information=_no_information(),
        doubtful=doubtful & solved,
        albedo_rgb=colour,
        notes=notes | {"depth_unit": unit},
    )


def _depth(
    images: ImageSet, normals: Float32Array, solved: BoolArray, sigma: Float32Array, keep_steps: bool
) -> tuple[Float32Array, str]:
    """Integrates normals to depth (H, W); returns it with its unit.

    The unit is m, `relative` (multiples of an unknown rough depth), or `pixel` for an orthographic camera.
    """
    planar = normals.transpose(2, 0, 1)  # no copy: it is read twice only
    if images.camera is None:
        return integration.orthographic_depth(
            planar, solved, _confidence(solved, sigma), keep_steps=keep_steps
        ), "pixel"
    rows, columns = slice(0, images.height), slice(0, images.width)
    ray = photometry.camera_rays(images.camera.matrix, images.camera.distortion, rows, columns)
    rough = images.rough_depth_m
    start = np.broadcast_to(np.asarray(1.0 if rough is None else rough, np.float32), solved.shape)
    depth = integration.depth(planar, solved, ray, _confidence(solved, sigma), start, keep_steps=keep_steps)
    depth[~solved] = 0
    return depth, "relative" if rough is None else "m"


def _confidence(solved: BoolArray, sigma: Float32Array) -> Float32Array:
    """Integration weight (H, W) of each normal, 0–1, from its σ in degrees; zero where it is not solved."""
    variance = np.radians(np.nan_to_num(sigma, nan=90.0))
    variance *= variance
    confidence = integration.confidence(variance)
    confidence[~solved] = 0
    return confidence


def _no_information() -> FisherInformation:
    """Empty Fisher information: a planner reads results of near light only."""
    none = np.empty(0, np.int64)
    return FisherInformation(none, none, np.empty((0, 4, 4)))
