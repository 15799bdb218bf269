"""Light that surfaces throw at one another, predicted from the images and taken out of them.

A matt surface's image is its own radiosity: what a pixel sends to the camera it sends everywhere. The light that it
receives from other surfaces therefore follows from the measured images and the present shape, without shadow
prediction, bounce series or unknown lamp terms. What the camera sees is a height field along its own rays, so the light
is gathered by horizons: in a plane through the camera's ray, walking outwards, each surface that rises above the
horizon so far fills the angle between, and the cosine-weighted integral over that angle is a closed form. That is exact
in visibility, and steps need no patches of their own: the wall under a step is the angle between foot and edge. The
camera does not see that wall; its radiosity is worked out from the lamps. The table is part of the height field.

How much of the prediction is really there is measured, not assumed: pixels in shadow are lit by nothing else.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from acquisition import photometry
from acquisition.measured import Calibration
from acquisition.normals import lambert
from acquisition.normals.lambert import Estimate, Pixels
from acquisition.types import BoolArray, Float32Array

AZIMUTHS = 24
LEVELS = 3
"""Parts of a wall's height that have a radiosity of their own."""

WALL_SLOPE = 2.5
WALL_BOUNCES = 1
SHADOW_CLEARANCE_M = 0.0003
BEYOND_PICTURE = 0.5
"""Radiosity of the table beyond the picture, as a share of what its border sends."""

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
    table: Table | None, lamp: Float32Array, calibration: Calibration,
) -> Float32Array:  # fmt: skip
    """What each pixel receives from other surfaces: irradiance (F, N) in the units of y, from images `values` (F, N).

    `depth_m` (N,) and `normals` (3, N) are the present shape. Without a table nothing surrounds the object.
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
    out = np.empty((len(pixels.index), len(values)), np.float32)
    cells = np.stack(np.unravel_index(pixels.index, pixels.shape), axis=1).astype(np.int32)
    own = np.ascontiguousarray(point.reshape(-1, 3)[pixels.index])
    _gather(point, own, np.ascontiguousarray(normals.T), cells, radiosity, walls.number, sent, out)
    return np.ascontiguousarray(out.T)


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
    moved = lambert.turned(found, right[:, :, None])
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
    number, cell, normal, top = _find_walls(point, inside, WALL_SLOPE)
    foot = point[cell[:, 0], cell[:, 1]]
    middle = np.repeat(foot[:, None], LEVELS, axis=1)
    middle[:, :, 2] += (np.arange(LEVELS) + 0.5) / LEVELS * (top - foot[:, 2])[:, None]
    # The albedo of a wall that nobody sees is that of its surroundings.
    weight = inside.astype(np.float32)
    around = cv2.blur(albedo * weight, (5, 5)) / np.maximum(cv2.blur(weight, (5, 5)), np.float32(1e-6))
    return _Walls(
        number=number,
        point=np.ascontiguousarray(middle.reshape(-1, 3), np.float32),
        normal=np.repeat(normal, LEVELS, axis=0),
        cell=np.repeat(cell, LEVELS, axis=0),
        albedo=np.repeat(np.asarray(around, np.float32)[cell[:, 0], cell[:, 1]], LEVELS),
    )


def _walls_radiosity(
    walls: _Walls, point: Float32Array, radiosity: Float32Array, lamp: Float32Array, calibration: Calibration,
    affine: np.ndarray,
) -> Float32Array:  # fmt: skip
    """What each wall sends at each level and light (W, LEVELS, F): the lamp's light where it is free, and bounces."""
    count = len(lamp)
    shape = (len(walls.point) // LEVELS, LEVELS, count)
    if shape[0] == 0:
        return np.zeros((0, LEVELS, count), np.float32)
    free = np.empty((len(walls.point), count), np.float32)
    _lit(point, walls.point, walls.normal, lamp, affine, free)
    light = photometry.light_vectors(np.ascontiguousarray(walls.point.T), lamp, calibration)
    falling = np.clip(np.einsum("fcn,nc->nf", light, walls.normal), 0, None) * free
    direct = np.ascontiguousarray(walls.albedo[:, None] * falling, np.float32)  # einsum may answer by columns
    sent = direct
    for _ in range(WALL_BOUNCES):
        bounced = np.empty_like(direct)
        _gather(point, walls.point, walls.normal, walls.cell, radiosity, walls.number, sent.reshape(shape), bounced)
        sent = np.ascontiguousarray(direct + walls.albedo[:, None] * bounced, np.float32)
    return sent.reshape(shape)


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], int32[:,::1], float32[:,:,::1], int32[:,::1],"
    " float32[:,:,::1], float32[:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def _gather(  # noqa: PLR0912, PLR0915 - one fused kernel is the point
    point: Float32Array,  # (h, w, 3)
    place: Float32Array,  # (K, 3) receivers
    normal: Float32Array,  # (K, 3)
    cell: np.ndarray,  # (K, 2)
    radiosity: Float32Array,  # (h, w, F)
    wall_number: np.ndarray,  # (h, w)
    wall_sent: Float32Array,  # (W, LEVELS, F)
    out: Float32Array,  # (K, F)
) -> None:
    height, width, count = radiosity.shape
    for i in numba.prange(place.shape[0]):
        px, py, pz = place[i, 0], place[i, 1], place[i, 2]
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        inverse = 1.0 / np.sqrt(px * px + py * py + pz * pz)
        vx, vy, vz = -px * inverse, -py * inverse, -pz * inverse  # to the camera
        b = nx * vx + ny * vy + nz * vz
        for f in range(count):
            out[i, f] = 0.0
        for k in range(AZIMUTHS):
            azimuth = 2.0 * np.pi * (k + 0.5) / AZIMUTHS
            across, down = np.cos(azimuth), np.sin(azimuth)
            # the unit vector across the camera's ray, towards that side of the picture
            dot = across * vx - down * vy
            tx, ty, tz = across - dot * vx, -down - dot * vy, -dot * vz
            inverse = 1.0 / np.sqrt(tx * tx + ty * ty + tz * tz)
            tx, ty, tz = tx * inverse, ty * inverse, tz * inverse
            a = nx * tx + ny * ty + nz * tz
            # Only directions before the tangent plane receive: a cos α + b sin α > 0.
            horizon, highest = -0.5 * np.pi, 0.5 * np.pi
            if b >= 0:
                horizon = max(-np.arctan2(a, b), -0.5 * np.pi)
            elif a > 0:
                highest = np.arctan2(a, -b)
            else:
                continue
            below = a * (horizon / 2 + np.sin(2 * horizon) / 4) + b * np.sin(horizon) ** 2 / 2
            steepest = np.tan(highest) if highest < 1.57 else 1e6
            lowest = np.tan(horizon) if horizon > -1.57 else -1e6
            major = max(abs(across), abs(down))
            step_u, step_v = across / major, down / major
            along_u = abs(across) >= abs(down)
            v_before, u_before = cell[i, 0], cell[i, 1]
            lx, ly, lz = point[v_before, u_before, 0], point[v_before, u_before, 1], point[v_before, u_before, 2]
            gone, stride = 0.0, 1.0
            for _ in range(4096):
                gone += stride
                u_exact, v_exact = cell[i, 1] + gone * step_u, cell[i, 0] + gone * step_v
                if along_u:
                    u0 = int(np.round(u_exact))
                    v0 = int(np.floor(v_exact))
                    u1, v1, share = u0, v0 + 1, v_exact - v0
                else:
                    v0 = int(np.round(v_exact))
                    u0 = int(np.floor(u_exact))
                    u1, v1, share = u0 + 1, v0, u_exact - u0
                if u0 < 0 or v0 < 0 or u1 >= width or v1 >= height:
                    break
                # Between two cells the surface is interpolated, except across a step.
                apart = abs(point[v1, u1, 0] - point[v0, u0, 0]) + abs(point[v1, u1, 1] - point[v0, u0, 1])
                v_near, u_near = (v0, u0) if share < 0.5 else (v1, u1)
                if abs(point[v1, u1, 2] - point[v0, u0, 2]) > WALL_SLOPE * apart:
                    share = 0.0 if share < 0.5 else 1.0
                x = (1 - share) * point[v0, u0, 0] + share * point[v1, u1, 0]
                y = (1 - share) * point[v0, u0, 1] + share * point[v1, u1, 1]
                z = (1 - share) * point[v0, u0, 2] + share * point[v1, u1, 2]
                rise = z - lz
                run = np.sqrt((x - lx) ** 2 + (y - ly) ** 2)
                wall = wall_number[v_before, u_before]
                jump = wall >= 0 and rise > WALL_SLOPE * run
                ex, ey, ez = x - px, y - py, z - pz
                if jump:  # the edge stands between the two cells
                    ex, ey = (x + lx) / 2 - px, (y + ly) / 2 - py
                outward = ex * tx + ey * ty + ez * tz
                if outward > 0:
                    slope = (ex * vx + ey * vy + ez * vz) / outward
                    if slope > lowest:
                        slope = min(slope, steepest)
                        angle = np.arctan(slope)
                        sine2 = slope * slope / (1 + slope * slope)
                        above = a * (angle + slope / (1 + slope * slope)) / 2 + b * sine2 / 2
                        weight = (above - below) * (2.0 / AZIMUTHS)
                        if jump:
                            middle = pz + (slope + max(lowest, (lz - pz) / outward)) / 2 * outward
                            level = int(min(max((middle - lz) / rise, 0.0), 0.999) * LEVELS)
                            for f in range(count):
                                out[i, f] += weight * wall_sent[wall, level, f]
                        else:
                            for f in range(count):
                                out[i, f] += weight * radiosity[v_near, u_near, f]
                        lowest, below = slope, above
                lx, ly, lz = x, y, z
                v_before, u_before = v_near, u_near
                if gone > 8:
                    stride = min(np.floor(gone / 6.0), 6.0)
            if lowest < 0 < highest:
                weight = BEYOND_PICTURE * -below * (2.0 / AZIMUTHS)
                for f in range(count):
                    out[i, f] += weight * radiosity[v_before, u_before, f]


@numba.njit(
    "Tuple((int32[:,::1], int32[:,::1], float32[:,::1], float32[::1]))(float32[:,:,::1], boolean[:,::1], float64)",
    cache=True,
    error_model="numpy",
)
def _find_walls(
    point: Float32Array, inside: BoolArray, slope: float
) -> tuple[np.ndarray, np.ndarray, Float32Array, Float32Array]:
    """Cells at the foot of a step: numbers (h, w), cells (W, 2), the wall's normals (W, 3) and its edge's z (W,)."""
    height, width = inside.shape
    number = np.full((height, width), -1, np.int32)
    cell = np.empty((height * width, 2), np.int32)
    normal = np.zeros((height * width, 3), np.float32)
    top = np.empty(height * width, np.float32)
    found = 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            x, y, z = point[v, u, 0], point[v, u, 1], point[v, u, 2]
            across, up, highest = 0.0, 0.0, 0.0
            for dv in range(-1, 2):
                for du in range(-1, 2):
                    if (dv == 0 and du == 0) or not inside[v + dv, u + du]:
                        continue
                    dx, dy = point[v + dv, u + du, 0] - x, point[v + dv, u + du, 1] - y
                    rise = point[v + dv, u + du, 2] - z
                    run = np.sqrt(dx * dx + dy * dy)
                    if rise > slope * run:
                        across -= dx / run * rise
                        up -= dy / run * rise
                        highest = max(highest, rise)
            length = np.sqrt(across * across + up * up)
            if highest > 0 and length > 0:
                number[v, u] = found
                cell[found, 0], cell[found, 1] = v, u
                normal[found, 0], normal[found, 1] = across / length, up / length
                top[found] = z + highest
                found += 1
    return number, cell[:found].copy(), normal[:found].copy(), top[:found].copy()


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float64[::1], float32[:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def _lit(
    point: Float32Array,  # (h, w, 3)
    place: Float32Array,  # (K, 3)
    normal: Float32Array,  # (K, 3)
    lamp: Float32Array,  # (F, 6)
    affine: np.ndarray,  # column and row as factor and offset of the rays
    out: Float32Array,  # (K, F): 1 where the way to the lamp is free
) -> None:
    height, width = point.shape[0], point.shape[1]
    for i in numba.prange(place.shape[0]):
        for f in range(lamp.shape[0]):
            dx, dy, dz = lamp[f, 0] - place[i, 0], lamp[f, 1] - place[i, 1], lamp[f, 2] - place[i, 2]
            out[i, f] = 0.0
            if dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2] <= 0:
                continue
            out[i, f] = 1.0
            pace = abs(place[i, 2] / affine[0]) / (np.sqrt(dx * dx + dy * dy) + 1e-6)
            for n in range(1, 1024):
                t = n * pace
                if t > 0.5:
                    break
                x, y, z = place[i, 0] + t * dx, place[i, 1] + t * dy, place[i, 2] + t * dz
                u = int(np.round(-x / z * affine[0] + affine[1]))
                v = int(np.round(y / z * affine[2] + affine[3]))
                if u < 0 or v < 0 or u >= width or v >= height:
                    break
                if point[v, u, 2] > z + SHADOW_CLEARANCE_M:
                    out[i, f] = 0.0
                    break


KERNELS = (_gather, _find_walls, _lit)
