"""Photometric stereo under distant lights: the limit of near light, and plain least squares to compare with.

Camera and lamps are placed so far away (`CAMERA_M`, a thousand times the object's size) that directions and irradiance
are the same all over the object, while its relief still casts shadows. `near_light` solves these images like any
others. An object of unknown scale counts as `OBJECT_SIZE_M` wide, and its brightest parts as nearly white; only priors
and indirect light depend on these two values.
"""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import LIT, SATURATED, FisherInformation, NormalMap, SolveSettings
from acquisition.normals import near_light
from acquisition.normals.alternatives import lamp_alternatives, model_trial
from acquisition.normals.brdf import reflectance_solve
from acquisition.normals.images import memory_mapped, silhouette
from acquisition.normals.images.image_set import (
    INTENSITY_SIGMA,
    POSITION_SIGMA_M,
    Camera,
    DistantLights,
    ImageSet,
    NearLights,
    check,
)
from acquisition.normals.images.normalised_images import row_blocks
from acquisition.normals.surface import integration

Solver = Literal["auto", "ls"]


OBJECT_SIZE_M = 0.1
"""Assumed length of the longer side of an object of unknown scale; shadows do not depend on it."""

DIRECTION_SIGMA_RAD = POSITION_SIGMA_M / (4 * OBJECT_SIZE_M)
"""1 σ of a light's direction: the default position error of a near light at four object sizes."""

CAMERA_M, LAMPS_M = 100.0, 90.0
"""Distances of camera and lamps from the object that stand for infinity. Irradiance varies by 0.2 % over the object and
directions by 0.03° at its edges, and single precision still resolves 8 µm of depth. No lamp is at the camera."""

BRIGHT_ALBEDO = 0.8
"""Assumed albedo of the brightest percent of the object; images do not determine the light's absolute strength."""

SAMPLE_ROWS = 48
"""Rows of each image from which its brightness is estimated."""

LUMA = np.array([0.2989, 0.5870, 0.1140])
"""Weights of R, G, B: luma of ITU-R BT.601, as usual in photometric stereo by plain least squares."""


def solve(images: ImageSet, solver: Solver = "auto", *, keep_steps: bool = False) -> NormalMap:
    """Solves an image set with DistantLights for normals, albedo, σ and depth.

    `auto` uses the near-light solver and, if many lights show that none of its models fits, `reflectance_solve`. `ls`
    is plain least squares of all measurements (Woodham 1980), a baseline. Without a mask, `silhouette.propose` finds
    the object where it is lit. Albedo is the brightness of a surface that faces a light of intensity 1, as a fraction
    of full scale. Depth is in pixels (`notes["depth_unit"]`) and has mean 0 over each connected part. `keep_steps` lets
    depth jump where normals disagree with their neighbours, see `integration.depth`. Raises RigError normals.infeasible
    as `image_set.check` and `solve_stack` do.
    """
    check(images)
    notes = {"solver": solver, "depth_unit": "pixel"}
    if not images.mask_given:
        images = replace(images, mask=silhouette.propose(images), mask_given=True)
        notes["mask"] = "proposed"
    if solver == "ls":
        solved = _least_squares_map(images)
    else:
        far = from_afar(images)
        white = np.float32(_white(images))
        many = images.count >= photometry.SETTINGS.many_lights
        solved = near_light.solve(far, SolveSettings(keep_steps=keep_steps), thorough=not many)
        as_stated = lamp_alternatives.AXES not in [finding.kind for finding in solved.findings]
        if many and as_stated and _unexplained(solved):
            solved = reflectance_solve.solve(near_light.windowed_images(far), _distant(images).units, solved)
        colour = None if solved.albedo_rgb is None else solved.albedo_rgb * white
        solved = replace(solved, albedo=solved.albedo * white, albedo_rgb=colour)
    variance = np.square(np.radians(np.nan_to_num(solved.sigma_deg, nan=90.0)))
    depth = integration.orthographic_depth(
        solved.normals.transpose(2, 0, 1), solved.mask, integration.confidence(variance), keep_steps=keep_steps
    )
    return replace(solved, depth=depth, notes=solved.notes | notes)


def _unexplained(solved: NormalMap) -> bool:
    """Whether no model of the whole object fits: a finding is not corrected, residuals exceed what lights' errors
    explain, or gloss is no dielectric's. Such lobes have many shapes: on a ball with a Gaussian lobe under 96 lights
    GGX of any strength leaves an error of 0.69°, lobes fitted to each pixel 0.51°."""
    return (
        any(not finding.corrected for finding in solved.findings)
        or not solved.notes["lobe"]["dielectric"]
        or solved.noise["direction"] > model_trial.SETTINGS.clearly_worse * DIRECTION_SIGMA_RAD
        or solved.noise["intensity"] > model_trial.SETTINGS.clearly_worse * INTENSITY_SIGMA
    )


def from_afar(images: ImageSet) -> ImageSet:
    """Converts the images to near light, with the camera at CAMERA_M and the lamps at LAMPS_M from the object.
    Raises RigError normals.infeasible if the lights are not directions."""
    lights, (rows, columns) = _distant(images), photometry.bounding_box(images.mask)
    focal = CAMERA_M * max(rows.stop - rows.start, columns.stop - columns.start) / OBJECT_SIZE_M
    middle = (columns.start + columns.stop - 1) / 2, (rows.start + rows.stop - 1) / 2
    strength = lights.intensities.mean(axis=1)
    return replace(
        images,
        lights=NearLights(
            positions_m=LAMPS_M * lights.units - np.array([0.0, 0.0, CAMERA_M]),
            intensity=strength * _white(images),
            reference_m=LAMPS_M,
            colour=lights.intensities / strength[:, None],
            position_sigma_m=DIRECTION_SIGMA_RAD * LAMPS_M,
        ),
        camera=Camera(np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])),
        rough_depth_m=CAMERA_M,
        metric=False,
    )


def _distant(images: ImageSet) -> DistantLights:
    if not isinstance(images.lights, DistantLights):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE, "the lights are positions, not directions: solve them as near lights"
        )
    return images.lights


def _white(images: ImageSet) -> float:
    """Returns the value of white that faces a light of intensity 1, for BRIGHT_ALBEDO in the median image."""
    rows = np.flatnonzero(np.any(images.mask, axis=1))
    rows = rows[np.linspace(0, len(rows) - 1, min(SAMPLE_ROWS, len(rows))).astype(int)].tolist()
    bright: list[float] = []
    most = 0.0
    for number, strength in enumerate(_distant(images).intensities.mean(axis=1).tolist()):
        values = np.concatenate([images.values(number, row, row + 1)[0][images.mask[row]] for row in rows])
        bright.append(float(np.quantile(values, 0.99)) / strength)
        most = max(most, float(np.max(values)) / strength)
    # A bound where hardly more than highlights is above black: squares of values over white have to fit into float32.
    return max(float(np.median(bright)), 1e-6 * most, 1e-30) / BRIGHT_ALBEDO


def _least_squares_map(images: ImageSet) -> NormalMap:
    """Solves the mask's pixels by Lambertian least squares (Woodham 1980), by blocks of rows; LUMA mixes colours."""
    lights, size = _distant(images), (images.height, images.width)
    maps: dict[str, Any] = {name: np.zeros(size, np.float32) for name in ("albedo", "residual", "depth")}
    maps |= {"normals": np.zeros((*size, 3), np.float32), "sigma_deg": np.full(size, np.nan, np.float32)}
    if images.channels == 3:
        maps["albedo_rgb"] = np.zeros((*size, 3), np.float32)
    flags = memory_mapped.zeros((images.count, *size))
    for rows in row_blocks(images.height):
        inside = images.mask[rows]
        stack = [images.values(number, rows.start, rows.stop)[inside] for number in range(images.count)]
        values = np.stack(stack).reshape(images.count, -1, images.channels)
        flags[:, rows][:, inside] = np.where(np.any(values >= images.saturated_from, axis=2), SATURATED, LIT)
        memory_mapped.release(flags)
        values = values / lights.intensities[:, None, : images.channels]
        grey = values @ LUMA if images.channels == 3 else values[..., 0]
        scaled, squared, variance = _least_squares(grey, lights.units)
        albedo = np.linalg.norm(scaled, axis=0)
        found = {
            "normals": (scaled / np.maximum(albedo, 1e-12)).T,
            "albedo": albedo,
            "residual": np.sqrt(squared),
            "sigma_deg": np.sqrt(photometry.bounded_variance(np.degrees(1) ** 2 * variance)),
        }
        if images.channels == 3:
            ratio = values.sum(axis=0) / np.maximum(grey.sum(axis=0), 1e-12)[:, None]
            found["albedo_rgb"] = albedo[:, None] * ratio
        for name, part in found.items():
            maps[name][rows][inside] = part
    return NormalMap(
        **maps,
        mask=maps["albedo"] > 0,
        silhouette=images.mask,
        flags=flags,
        intensity_factors=np.ones(images.count),
        information=FisherInformation(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4, 4))),
        doubtful=np.zeros(size, np.bool_),
        notes={"why": "plain least squares on request: all measurements, shadows and highlights included"},
    )


def _least_squares(values: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solves values (F, N) under unit directions (F, 3) for albedo × normal (3, N). Also returns the mean square
    residual (N,) and the variance (N,), rad², of the normals over both tangential directions."""
    scaled = np.linalg.pinv(directions) @ values
    squared = np.sum((values - directions @ scaled) ** 2, axis=0)
    inverse, count = np.linalg.inv(directions.T @ directions), len(directions)
    power = np.maximum(np.sum(scaled**2, axis=0), 1e-12)
    if count > photometry.PIXEL_UNKNOWNS:
        leverage = np.trace(inverse) - np.einsum("an,ab,bn->n", scaled, inverse, scaled) / power
        variance = squared / (count - photometry.PIXEL_UNKNOWNS) * leverage / power
    else:  # no residual is left to estimate the noise from
        variance = np.full_like(power, np.radians(photometry.SETTINGS.unchecked_sigma_deg) ** 2)
    return scaled, squared / count, variance
