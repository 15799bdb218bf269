"""Light that surfaces throw at one another, predicted from the images and taken out of them.

A matt surface's image is its own radiosity: what a pixel sends to the camera it sends everywhere. The light that it
receives from other surfaces therefore follows from the measured images and the present shape, without shadow
prediction, bounce series or unknown lamp terms. What the camera sees is a height field along its own rays, so the light
is gathered by horizons: in a plane through the camera's ray, walking outwards, each surface that rises above the
horizon so far fills the angle between, and the cosine-weighted integral over that angle is a closed form. That is exact
in visibility, and steps need no patches of their own: the wall under a step is the angle between foot and edge. The
camera does not see that wall; its radiosity is worked out from the lamps. The table is part of the height field.

How much of the prediction is really there is measured, not assumed: pixels in shadow are lit by nothing else.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.normals import interreflection_kernels, pixel_solve
from acquisition.normals.pixel_solve import Estimate, Pixels

AZIMUTHS, WALL_AZIMUTHS = 24, 12
"""Planes in which light is gathered; for what walls send on of it fewer will do."""

WALL_BOUNCES = 1
NOTHING = 2.0
"""Where there is no table, nothing stands within so many times the object's depth."""

LEAST_EVIDENCE = 30
LEAST_PREDICTION = 0.002
LEAST_THERE = 0.35
THERE_AT = 0.75
"""Bounced light is there when, of what is predicted in shadows, more than a quarter by its strength is measured at
least LEAST_THERE times as bright. A quarter, because a shape that is still wrong also predicts light where none falls;
where there is only direct light, shadows are black everywhere."""

TOGETHER = 0.2
"""1 σ of the factor by which a pixel's indirect light is wrong under all lights alike."""

PHYSICAL = (1.0, 1.1)
"""Scales of the prediction: what surfaces send that the camera does not see adds to it."""

TURNED_AWAY = -0.1
FACING = 0.35
IN_SHADOW = 0.4
"""A pixel is in cast shadow when it faces the lamp by the cosine FACING and sends less than IN_SHADOW of what it then
should; it is in its own shadow when the cosine is below TURNED_AWAY."""


@dataclass(frozen=True)
class Table:
    """What surrounds the object in the window, on the grid of its pixels: depth (h, w) in m and images (F, h, w)."""

    depth_m: Float32Array
    values: Float32Array


@dataclass(frozen=True)
class _Walls:
    """Walls under depth steps: number of each cell at their foot or −1 (h, w), and their middle points and normals at
    each level (W · LEVELS, 3), feet's cells (W · LEVELS, 2), albedo (W · LEVELS,)."""

    number: np.ndarray
    point: Float32Array
    normal: Float32Array
    cell: np.ndarray
    albedo: Float32Array


def received(
    pixels: Pixels, values: Float32Array, found: Estimate, depth_m: Float32Array, normals: Float32Array,
    table: Table | None, lamp: Float32Array, calibration: Calibration, every: int = 1,
) -> Float32Array:  # fmt: skip
    """What each pixel receives from other surfaces: irradiance (F, N) in the units of y, from images `values` (F, N).

    `depth_m` (N,) and `normals` (3, N) are the present shape. Without a table nothing surrounds the object. Only one
    of `every` so many pixels is worked out, the others are zero.
    """
    height, width = pixels.shape
    inside = pixels.image(np.ones(len(pixels.index), np.bool_))
    columns, rows = _linear_rays(pixels)
    around = np.meshgrid((np.arange(width) - columns[1]) / columns[0], (np.arange(height) - rows[1]) / rows[0])
    ray = np.where(inside, pixels.image(pixels.ray), np.stack(around)).astype(np.float32)
    along = photometry.ray_directions(ray)
    depth = np.full(pixels.shape, NOTHING * float(np.max(depth_m))) if table is None else table.depth_m
    bright = np.float32(0) if table is None else table.values
    depth = np.where(inside, pixels.image(depth_m), depth)
    point = np.ascontiguousarray((along * depth).transpose(1, 2, 0), np.float32)
    radiosity = np.ascontiguousarray(np.where(inside, pixels.image(values), bright).transpose(1, 2, 0), np.float32)
    albedo = pixels.image(np.minimum(found.albedo, 1))
    affine = np.array([*columns, *rows])
    walls = _walls(point, inside, albedo)
    sent = _walls_radiosity(walls, point, radiosity, lamp, calibration, affine)
    chosen = pixels.index[::every]
    cells = np.stack(np.unravel_index(chosen, pixels.shape), axis=1).astype(np.int32)
    facing = np.ascontiguousarray(normals[:, ::every].T)
    own = np.empty((len(chosen), len(values)), np.float32)
    interreflection_kernels.gather(
        point, point.reshape(-1, 3)[chosen], facing, cells, radiosity, walls.number, sent, AZIMUTHS, own
    )
    out = np.zeros(values.shape, np.float32)
    out[:, ::every] = own.T
    return out


def sent_on(received: Float32Array, values: Float32Array, direct: Float32Array, albedo: Float32Array) -> Float32Array:
    """What pixels send of what they receive (F, N), from images (F, N), and the albedo (N,) that `direct` (F, N) gave.

    While some bounced light is still in `direct`, or too much was taken out, that albedo is as wrong. The right one
    gives both the direct light and the received light, which makes up the image: ρ Σ(direct / albedo + received) =
    Σ values. Without this, turn after turn would over- and undershoot by the share of the bounced light.
    """
    whole = np.maximum(np.sum(values, axis=0), np.float32(1e-9))
    matt = np.maximum(np.sum(direct, axis=0), 0) + albedo * np.sum(received, axis=0)
    return received * np.minimum(albedo * whole / np.maximum(matt, np.float32(1e-9)), 1)


def scale(pixels: Pixels, values: Float32Array, predicted: Float32Array, found: Estimate) -> float:
    """How much of the predicted indirect light (F, N) to take out: none where shadows are darker than it.

    Shadows tell whether it is there at all, weighing each by its prediction; how much follows from the prediction,
    because while the shape is still wrong they understate it. `values` (F, N) are measured.
    """
    upper, middle = _found_in_shadows(pixels, values, predicted, found)
    return 0.0 if upper < LEAST_THERE else float(np.clip(middle, *PHYSICAL))


def spread(found: Estimate, indirect: Float32Array) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, if a pixel's indirect light (F, N) is off by
    one factor under all lights: what prediction misses, a surface that nobody sees, it misses under each of them."""
    right = np.einsum("fn,fn,fan->na", found.weights, indirect, found.light, optimize=True).astype(np.float64)
    moved = pixel_solve.normal_perturbation(found, right[:, :, None])
    return (TOGETHER**2 * np.sum(moved * moved, axis=(1, 2))).astype(np.float32)


def _found_in_shadows(
    pixels: Pixels, values: Float32Array, predicted: Float32Array, found: Estimate
) -> tuple[float, float]:
    """Quantile THERE_AT and median of measured / predicted in shadows, weighted by the prediction; 1 where few tell."""
    direct = np.einsum("fcn,cn->fn", found.light, found.g)
    strength = np.sqrt(np.einsum("fcn,fcn->fn", found.light, found.light)) * found.albedo
    cast = (direct > FACING * strength) & (values < IN_SHADOW * direct)
    dark = ((direct < TURNED_AWAY * strength) | cast) & ~pixels.clipped
    kernel = np.ones((3, 3), np.uint8)
    deep = np.stack([pixels.take(cv2.erode(pixels.image(one.astype(np.uint8)), kernel)) > 0 for one in dark])
    telling = deep & (predicted > LEAST_PREDICTION)
    if np.count_nonzero(telling) < LEAST_EVIDENCE:
        return 1.0, 1.0
    ratio, weight = values[telling] / predicted[telling], predicted[telling]
    order = np.argsort(ratio)
    summed = np.cumsum(weight[order])
    upper, middle = ratio[order][np.searchsorted(summed, summed[-1] * np.array([THERE_AT, 0.5]))]
    return float(upper), float(middle)


def _linear_rays(pixels: Pixels) -> tuple[np.ndarray, np.ndarray]:
    """Column and row as linear functions (factor, offset) of the rays, good to a fraction of a coarse pixel."""
    row, column = np.unravel_index(pixels.index, pixels.shape)
    return np.polyfit(pixels.ray[0], column, 1), np.polyfit(pixels.ray[1], row, 1)


def _walls(point: Float32Array, inside: BoolArray, albedo: Float32Array) -> _Walls:
    number, cell, normal, top = interreflection_kernels.find_walls(point, inside)
    foot = point[cell[:, 0], cell[:, 1]]
    middle = np.repeat(foot[:, None], interreflection_kernels.LEVELS, axis=1)
    middle[:, :, 2] += (
        (np.arange(interreflection_kernels.LEVELS) + 0.5) / interreflection_kernels.LEVELS * (top - foot[:, 2])[:, None]
    )
    # The albedo of a wall that nobody sees is that of its surroundings.
    weight = inside.astype(np.float32)
    around = cv2.blur(albedo * weight, (5, 5)) / np.maximum(cv2.blur(weight, (5, 5)), np.float32(1e-6))
    return _Walls(
        number=number,
        point=np.ascontiguousarray(middle.reshape(-1, 3), np.float32),
        normal=np.repeat(normal, interreflection_kernels.LEVELS, axis=0),
        cell=np.repeat(cell, interreflection_kernels.LEVELS, axis=0),
        albedo=np.repeat(np.asarray(around, np.float32)[cell[:, 0], cell[:, 1]], interreflection_kernels.LEVELS),
    )


def _walls_radiosity(
    walls: _Walls, point: Float32Array, radiosity: Float32Array, lamp: Float32Array, calibration: Calibration,
    affine: np.ndarray,
) -> Float32Array:  # fmt: skip
    """What each wall sends at each level and light (W, LEVELS, F): the lamp's light where it is free, and bounces."""
    count = len(lamp)
    shape = (len(walls.point) // interreflection_kernels.LEVELS, interreflection_kernels.LEVELS, count)
    if shape[0] == 0:
        return np.zeros((0, interreflection_kernels.LEVELS, count), np.float32)
    free = np.empty((len(walls.point), count), np.float32)
    interreflection_kernels.lit(point, walls.point, walls.normal, lamp, affine, free)
    light = photometry.light_vectors(np.ascontiguousarray(walls.point.T), lamp, calibration)
    falling = np.clip(np.einsum("fcn,nc->nf", light, walls.normal), 0, None) * free
    direct = np.ascontiguousarray(walls.albedo[:, None] * falling, np.float32)  # einsum may answer by columns
    sent = direct
    for _ in range(WALL_BOUNCES):
        bounced = np.empty_like(direct)
        interreflection_kernels.gather(
            point, walls.point, walls.normal, walls.cell, radiosity, walls.number, sent.reshape(shape),
            WALL_AZIMUTHS, bounced,
        )  # fmt: skip
        sent = np.ascontiguousarray(direct + walls.albedo[:, None] * bounced, np.float32)
    return sent.reshape(shape)
