"""Interreflection by the radiosity of the measured images, gathered over horizons of the height field, and its removal.

The image of a diffuse surface is its own radiosity: it sends the same light in all directions as to the camera. The
irradiance that a pixel receives from other surfaces therefore follows from the measured images and the present shape,
without shadow prediction, bounce series or unknown lamp terms.

The camera sees a height field along its own rays, so the light is gathered by horizon marching
(`interreflection_kernels`). Visibility is exact, and discontinuities need no patches of their own: the wall under an
edge fills the angle between foot and edge. The camera does not see that wall; its radiosity is calculated from the
lamps. The table is part of the height field. The same horizons give the sky view factor for ambient light.

Shadows decide whether the predicted indirect light exists (`shadow_light`). Its subtraction lowers the mean error of a
path-traced scene of albedo 0.7 from 4.05° to 1.51° (eight lights).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import cast_shadows, photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.models.tuned import tuned
from acquisition.normals.indirect_light import interreflection_kernels
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.pixel_solve import Estimate, Pixels

AZIMUTHS, WALL_AZIMUTHS = 16, 8
"""Numbers of planes in which light is gathered for pixels and for walls, whose reflected light needs fewer. Measured on
35 captures of vessels, machined and turned parts, clusters and knots of design seeds 205–225 (eight lights by two
rings): errors are 0.998 ± 0.010 of those with 24 and 12, of clusters 1.003 and knots 1.006; with 12 and 8 these two are
1.006 and 1.012 (scratch evaluation, November 2026)."""


@dataclass(frozen=True)
class InterreflectionSettings:
    """Tuned number of the indirect light."""

    direct_ratio: float = tuned(2.0, "ratio")
    """Ratio of a value to the indirect light that a pixel of median albedo would reflect, above which the value can be
    direct light. A larger ratio makes more pixels count as hardly lit. Measured on 19 Lambertian captures of design
    seeds 0, 1, 20, 21, 60 and 63, some dark-and-bright: 65 % of pixels that no lamp reaches count so, 95 % of those
    that one reaches, and 0.4 % of those of three or more, whose error is 12°; with 1.4 it is 51, 94 and 0.2 %, with 3
    75, 95 and 1.0 %."""

    @property
    def wall_slope(self) -> float:
        """Rise over run between neighbouring cells from which there is a wall between them: that of 66°, the slant of
        the most slanted light. Measured: with 51° and 79° errors change by 0.2 % at most."""
        return math.tan(math.acos(photometry.SETTINGS.grazing_cosine))


SETTINGS = InterreflectionSettings()


@dataclass(frozen=True)
class Table:
    """Surroundings of the object in its window, on the same grid: depth (h, w) in m and images (F, h, w)."""

    depth_m: Float32Array
    values: Float32Array


@dataclass(frozen=True)
class Surface:
    """The present surface at N pixels: depth (N,) in m, unit normals (3, N), albedo (N,), and the table, if any."""

    depth_m: Float32Array
    normals: Float32Array
    albedo: Float32Array
    table: Table | None


@dataclass(frozen=True)
class _Walls:
    """Walls under depth discontinuities: `number` (h, w) of the wall at the cells of their feet, else −1; for each
    level points and normals (W · LEVELS, 3), cells of the feet (W · LEVELS, 2) and albedo (W · LEVELS,)."""

    number: np.ndarray
    point: Float32Array
    normal: Float32Array
    cell: np.ndarray
    albedo: Float32Array


def received_irradiance(
    pixels: Pixels, values: Float32Array, surface: Surface, lamp: Float32Array, calibration: Calibration,
    every: int = 1,
) -> Float32Array:  # fmt: skip
    """Gathers indirect irradiance (F, N) over horizons, in the units of y, from images `values` (F, N) as radiosity.

    It is calculated at every `every`-th pixel and 0 at the others. `lamp` (F, 6 or 9) is in the view frame, m.
    """
    point, inside, affine = _height_field(pixels, surface.depth_m, surface.table)
    bright = np.float32(0) if surface.table is None else surface.table.values
    radiosity = np.ascontiguousarray(np.where(inside, pixels.image(values), bright).transpose(1, 2, 0), np.float32)
    walls = _walls(point, inside, pixels.image(np.minimum(surface.albedo, 1)))
    wall_radiosity = _wall_radiosity(walls, point, radiosity, lamp, calibration, affine)
    out = np.zeros(values.shape, np.float32)
    out[:, ::every] = _gathered(
        pixels.index[::every], surface.normals[:, ::every], point, radiosity, walls, wall_radiosity
    )
    return out


def sky_view(pixels: Pixels, depth_m: Float32Array, normals: Float32Array, table: Table | None) -> Float32Array:
    """Returns the sky view factor (N,), the share of the sky that a pixel sees, weighted by the cosine to its normal.

    It is gathered over horizons (ambient occlusion), at depth (N,) in m and unit normals (3, N). Measured at the true
    shape, with the light that other surfaces send on: its correlation with path-traced ambient light is 0.96–0.995 for
    six objects, and 0.72 for a sheet, which sees all of the sky but a hundredth (design seeds 62, 63, 203 and 206;
    scratch evaluation, November 2026).
    """
    point, inside, _ = _height_field(pixels, depth_m, table)
    # From surfaces of radiosity 1 a pixel receives the share of its sky that they hide.
    bright = (inside if table is None else np.ones_like(inside)).astype(np.float32)
    walls = _walls(point, inside, bright)
    of_walls = np.ones((len(walls.point) // interreflection_kernels.LEVELS, interreflection_kernels.LEVELS, 1))
    hidden = _gathered(pixels.index, normals, point, bright[..., None], walls, of_walls.astype(np.float32))
    return np.clip(1 - hidden[0], 0, 1)


def reflected_radiosity(
    received: Float32Array, total: Float32Array, direct: Float32Array, albedo: Float32Array
) -> Float32Array:
    """Reflects received irradiance (F, N) with a consistent albedo: indirect radiance (F, N), in the units of y.

    `total` (N,) and `direct` (N,) are sums of values over the images, and `albedo` (N,) was fitted to the direct ones.
    If these still contain indirect light, or lack direct light, the albedo is wrong in proportion. The consistent
    albedo ρ explains direct and received light together, ρ Σ(direct / albedo + received) = `total`. Without it
    iterations oscillate by the indirect share.
    """
    explained = np.maximum(direct, 0) + albedo * np.sum(received, axis=0)
    total = np.maximum(total, np.float32(1e-9))
    return received * np.minimum(albedo * total / np.maximum(explained, np.float32(1e-9)), 1)


def hardly_lit(received: Float32Array, values: Float32Array, median_albedo: float) -> BoolArray:
    """Pixels (N,) that hardly any lamp reaches: at most one of the diffuse `values` (F, N) can be direct light.

    A value can be direct light if it is not dim beside the largest, and well above the part of the `received`
    irradiance (F, N) that a surface of median albedo would reflect. A dark surface under the lamps would explain the
    values too, with a wrong normal; but lamps that reach it would give values of one order, well above indirect light.
    """
    direct = values > np.float32(photometry.SETTINGS.grazing_cosine) * np.max(values, axis=0)
    direct &= values > np.float32(SETTINGS.direct_ratio * median_albedo) * received
    return np.count_nonzero(direct, axis=0) <= 1


def normal_variance(estimate: Estimate, indirect: Float32Array) -> Float32Array:
    """Propagates `predicted_light_sigma` to the normals: variance (N,), rad², over both tangential directions.

    A pixel's indirect light (F, N) is wrong by one factor under all lights, as hidden surfaces are missing in each.
    """
    right = np.einsum("fn,fn,fan->na", estimate.weights, indirect, estimate.light, optimize=True).astype(np.float64)
    moved = pixel_solve.normal_perturbation(estimate, right[:, :, None])
    return (photometry.SETTINGS.predicted_light_sigma**2 * np.sum(moved * moved, axis=(1, 2))).astype(np.float32)


def _gathered(
    chosen: np.ndarray, normals: Float32Array, point: Float32Array, radiosity: Float32Array, walls: _Walls,
    wall_radiosity: Float32Array,
) -> Float32Array:  # fmt: skip
    """Gathers the irradiance (F, K) of the cells with flat numbers `chosen` (K,) and normals (3, K) from a window's
    radiosity (h, w, F) and that of its walls (W, LEVELS, F)."""
    cells = np.stack(np.unravel_index(chosen, point.shape[:2]), axis=1).astype(np.int32)
    out = np.empty((len(chosen), radiosity.shape[2]), np.float32)
    interreflection_kernels.gather(
        point, point.reshape(-1, 3)[chosen], np.ascontiguousarray(normals.T), cells, radiosity, walls.number,
        wall_radiosity, AZIMUTHS, SETTINGS.wall_slope, out,
    )  # fmt: skip
    return out.T


def _height_field(
    pixels: Pixels, depth_m: Float32Array, table: Table | None
) -> tuple[Float32Array, BoolArray, np.ndarray]:
    """Returns the window's points (h, w, 3), view frame, the object's pixels (h, w), and the linear fit (4,) of column
    and row to the rays. Without a table, the surroundings are a plane that touches the object from behind."""
    height, width = pixels.shape
    inside = pixels.image(np.ones(len(pixels.index), np.bool_))
    columns, rows = _linear_rays(pixels)
    rays_around = np.meshgrid((np.arange(width) - columns[1]) / columns[0], (np.arange(height) - rows[1]) / rows[0])
    ray = np.where(inside, pixels.image(pixels.ray), np.stack(rays_around)).astype(np.float32)
    around = np.full(pixels.shape, np.max(depth_m)) if table is None else table.depth_m
    depth = np.where(inside, pixels.image(depth_m), around)
    point = np.ascontiguousarray((photometry.ray_directions(ray) * depth).transpose(1, 2, 0), np.float32)
    return point, inside, np.array([*columns, *rows])


def _linear_rays(pixels: Pixels) -> tuple[np.ndarray, np.ndarray]:
    """Fits column and row (factor, offset) linearly to the rays; the error is a fraction of a coarse pixel."""
    row, column = np.unravel_index(pixels.index, pixels.shape)
    return np.polyfit(pixels.ray[0], column, 1), np.polyfit(pixels.ray[1], row, 1)


def _walls(point: Float32Array, inside: BoolArray, albedo: Float32Array) -> _Walls:
    """Finds the vertical walls under depth discontinuities of points (h, w, 3), divided into LEVELS."""
    number, cell, normal, top = interreflection_kernels.find_walls(point, inside, SETTINGS.wall_slope)
    foot = point[cell[:, 0], cell[:, 1]]
    middle = np.repeat(foot[:, None], interreflection_kernels.LEVELS, axis=1)
    middle[:, :, 2] += (
        (np.arange(interreflection_kernels.LEVELS) + 0.5) / interreflection_kernels.LEVELS * (top - foot[:, 2])[:, None]
    )
    # The camera does not see the wall; it is assumed to have the albedo of its surroundings.
    weight = inside.astype(np.float32)
    around = cv2.blur(albedo * weight, (5, 5)) / np.maximum(cv2.blur(weight, (5, 5)), np.float32(1e-6))
    return _Walls(
        number=number,
        point=np.ascontiguousarray(middle.reshape(-1, 3), np.float32),
        normal=np.repeat(normal, interreflection_kernels.LEVELS, axis=0),
        cell=np.repeat(cell, interreflection_kernels.LEVELS, axis=0),
        albedo=np.repeat(np.asarray(around, np.float32)[cell[:, 0], cell[:, 1]], interreflection_kernels.LEVELS),
    )


def _wall_radiosity(
    walls: _Walls, point: Float32Array, radiosity: Float32Array, lamp: Float32Array, calibration: Calibration,
    affine: np.ndarray,
) -> Float32Array:  # fmt: skip
    """Returns the radiosity of each wall (W, LEVELS, F) by level and light: unoccluded lamp light and one bounce."""
    count = len(lamp)
    shape = (
        len(walls.point) // interreflection_kernels.LEVELS,
        interreflection_kernels.LEVELS,
        count,
    )
    if shape[0] == 0:
        return np.zeros((0, interreflection_kernels.LEVELS, count), np.float32)
    depth = np.ascontiguousarray(-point[..., 2])
    nearest = float(np.min(depth))
    clearance = cast_shadows.clearance(depth, affine, walls.point.T, lamp, nearest, nearest / affine[0])
    light = photometry.light_vectors(walls.point.T, lamp, calibration)
    irradiance = np.clip(np.einsum("fcn,nc->nf", light, walls.normal), 0, None) * (clearance.T > 0)
    direct = np.ascontiguousarray(walls.albedo[:, None] * irradiance, np.float32)  # einsum may return column order
    indirect = np.empty_like(direct)
    interreflection_kernels.gather(
        point, walls.point, walls.normal, walls.cell, radiosity, walls.number, direct.reshape(shape), WALL_AZIMUTHS,
        SETTINGS.wall_slope, indirect,
    )  # fmt: skip
    return (direct + walls.albedo[:, None] * indirect).astype(np.float32).reshape(shape)
