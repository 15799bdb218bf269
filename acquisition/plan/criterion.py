"""The expected angular variance of each pixel's normal under a set of lights.

A sample pixel knows (g, ζ), albedo × normal and a depth offset, with the information that the images so far gave it. A
candidate light adds a row to it: its light vector there, weighted by the noise that the exposure for that light would
bring. Whether the pixel will see the light at all is a probability, of being turned to it and of nothing standing
between, known as well as the pilot's shape is. Three scenarios carry that into the criterion: each holds every light of
probability above its level visible, because an error of one pixel's normal hides all lights of one side together.
Multiplying information by probability instead would be optimistic.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import ndtr

from acquisition import photometry
from acquisition.plan import kernels
from acquisition.types import (
    ATTACHED,
    CAST,
    Calibration,
    Float32Array,
    FloatArray,
    Light,
    NormalMap,
    Observations,
    Recipe,
)

LEVELS = (1 / 6, 1 / 2, 5 / 6)
OFFSET_SIGMA_M = 0.003
CAP_DEG = 10.0
"""Objective per pixel: v / (1 + v/cap²); a few pixels that no light can reach must not decide for all others."""

PRIOR_SCALE = 0.5
LEAST_COSINE = 0.08
SURE = 0.9
ATTACHED_SIGMA = 0.06
CAST_SIGMA = 0.04
MAP_SIZE = 192
STEEPEST_DEG = 78.0


@dataclass(frozen=True)
class Samples:
    """Sample pixels: what the images so far say of them."""

    row: np.ndarray  # (P,)
    column: np.ndarray  # (P,)
    point: Float32Array  # (3, P) m, view frame
    along: Float32Array  # (3, P) ∂x/∂Z
    normal: Float32Array  # (3, P)
    albedo: Float32Array  # (P,)
    sigma: Float32Array  # (P,) rad
    information: FloatArray  # (P, 4, 4) of (g, ζ), weak prior included


@dataclass(frozen=True)
class Candidates:
    """What each candidate light would tell each sample pixel."""

    row: Float32Array  # (K, 4, P) whitened
    visibility: Float32Array  # (K, P) probability

    def only(self, chosen: list[int]) -> "Candidates":
        """Some of the candidates."""
        return Candidates(np.ascontiguousarray(self.row[chosen]), np.ascontiguousarray(self.visibility[chosen]))


def samples(normal_map: NormalMap, calibration: Calibration, chosen: np.ndarray) -> Samples:
    """The sample pixels of a normal map with these numbers in its `information`."""
    rows, columns = normal_map.information.rows[chosen], normal_map.information.columns[chosen]
    ray = _rays_at(calibration, rows, columns)
    depth = normal_map.depth[rows, columns]
    albedo = np.maximum(normal_map.albedo[rows, columns], 1e-3)
    scale = np.array([1.0, 1.0, 1.0, OFFSET_SIGMA_M])
    information = normal_map.information.matrices[chosen] * np.outer(scale, scale)
    weak = np.zeros((len(chosen), 4, 4))
    weak[:, (0, 1, 2), (0, 1, 2)] = (1.0 / (PRIOR_SCALE * albedo) ** 2)[:, None]
    weak[:, 3, 3] = 1.0
    return Samples(
        row=rows,
        column=columns,
        point=photometry.points(ray, depth),
        along=photometry.ray_directions(ray),
        normal=np.ascontiguousarray(normal_map.normals[rows, columns].T),
        albedo=albedo,
        sigma=np.radians(np.nan_to_num(normal_map.sigma_deg[rows, columns], nan=40.0)).astype(np.float32),
        information=information + weak,
    )


def usable(normal_map: NormalMap, calibration: Calibration) -> np.ndarray:
    """Numbers of the information's pixels that a plan can reason about: finite, and not seen edge-on."""
    information = normal_map.information
    rows, columns = information.rows, information.columns
    if not len(rows):
        return np.empty(0, dtype=np.int64)
    along = photometry.ray_directions(_rays_at(calibration, rows, columns))
    normal = normal_map.normals[rows, columns].T
    cosine = -np.sum(normal * along, axis=0) / np.sqrt(np.sum(along * along, axis=0))
    finite = (
        np.isfinite(information.matrices).all(axis=(1, 2))
        & np.isfinite(normal).all(axis=0)
        & np.isfinite(normal_map.depth[rows, columns])
        & np.isfinite(normal_map.albedo[rows, columns])
        & (normal_map.depth[rows, columns] > 0)
    )
    return np.flatnonzero(finite & (cosine > np.cos(np.radians(STEEPEST_DEG))))


def candidates(
    sample: Samples, lights: list[Light], normal_map: NormalMap, calibration: Calibration, recipe: Recipe
) -> Candidates:
    """Rows and visibilities of lights at the sample pixels, with the exposure that each light would get."""
    lamp = photometry.lamps(lights)
    light = photometry.light_vectors(sample.point, lamp, calibration)
    strength = np.sqrt(np.einsum("fcp,fcp->fp", light, light))
    distance = np.sqrt(np.sum((lamp[:, :3, None] - sample.point[None]) ** 2, axis=1))
    cosine = np.einsum("fcp,cp->fp", light, sample.normal) / np.maximum(strength, 1e-9)
    value = np.maximum(cosine, LEAST_COSINE) * strength * sample.albedo

    spread = sample.sigma / np.sqrt(2.0)
    margin = _clearance(sample.point, lamp, normal_map, calibration)
    visibility = ndtr((cosine - LEAST_COSINE) / np.hypot(ATTACHED_SIGMA, spread)) * ndtr(
        margin / np.hypot(CAST_SIGMA, spread)
    )
    lit = np.where(visibility > 0.5, value, 0.0)
    brightest = np.maximum(np.quantile(lit, 0.995, axis=1), 1e-4)
    level = recipe.exposure.target / brightest
    if recipe.exposure.seconds is not None:
        level = np.full_like(brightest, recipe.exposure.seconds * calibration.lamp_intensity)
    sensor = calibration.sensor
    clipping = (photometry.clipping_dn(sensor) - sensor.black_level_dn) / sensor.full_scale_dn
    visibility = np.where(value * level[:, None] > clipping, 0.0, visibility)

    noise = photometry.noise(calibration, list(level / calibration.lamp_intensity), float(np.mean(distance)))
    deviation = np.sqrt(noise.variance(value, sample.albedo * strength))
    turning = np.einsum("fcp,cp->fp", light, sample.along) / np.maximum(strength, 1e-9)
    facing = np.einsum("cp,cp->p", sample.normal, sample.along)
    slope = -sample.albedo * strength / distance * (facing - 3 * cosine * turning) * OFFSET_SIGMA_M
    row = np.concatenate([light, slope[:, None]], axis=1) / deviation[:, None]
    return Candidates(np.ascontiguousarray(row, np.float32), np.ascontiguousarray(visibility, np.float32))


def unexplained_shadows(
    sample: Samples, normal_map: NormalMap, observations: Observations, calibration: Calibration, recipe: Recipe
) -> float:
    """Share of the measurements found dark among those that the normal map's own shape would surely light.

    Integrating normals closes steps that no pixel sees; the shadows that they cast remain, and give them away.
    """
    lights = [shot.light for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    if not lights or len(lights) != len(normal_map.flags):
        return 0.0
    sure = candidates(sample, lights, normal_map, calibration, recipe).visibility > SURE
    dark = normal_map.flags[:, sample.row, sample.column] & (ATTACHED | CAST) > 0
    return float(np.mean(dark[sure])) if np.any(sure) else 0.0


@dataclass(frozen=True)
class Expectation:
    """Covariance and angular variance of all sample pixels in all scenarios after some lights."""

    covariance: FloatArray  # (S, P, 4, 4)
    variance: FloatArray  # (S, P) rad²

    @property
    def objective(self) -> float:
        """Mean capped variance, rad²."""
        cap = np.radians(CAP_DEG) ** 2
        return float(np.mean(self.variance / (1 + self.variance / cap)))

    @property
    def sigma_deg(self) -> FloatArray:
        """Expected σ (P,) over the scenarios, degrees."""
        return np.degrees(np.mean(np.sqrt(self.variance), axis=0))


def expect(sample: Samples, lights: Candidates) -> Expectation:
    """What is to be expected after adding all of `lights`."""
    row = lights.row.astype(np.float64)
    seen = np.stack([lights.visibility > level for level in LEVELS]).astype(np.float64)  # (S, K, P)
    gained = np.einsum("skp,kap,kbp->spab", seen, row, row, optimize=True)
    covariance = np.linalg.inv(sample.information + gained)
    trace = covariance[..., 0, 0] + covariance[..., 1, 1] + covariance[..., 2, 2]
    inner = np.einsum("ap,spab,bp->sp", sample.normal, covariance[..., :3, :3], sample.normal, optimize=True)
    return Expectation(covariance, np.maximum(trace - inner, 1e-12) / sample.albedo**2)


def scan(sample: Samples, present: Expectation, lights: Candidates) -> FloatArray:
    """The objective (K,) with each one of `lights` added to what is present."""
    upper = np.triu_indices(4)
    covariance = present.covariance[..., upper[0], upper[1]].transpose(0, 2, 1)
    out = np.empty(len(lights.row))
    kernels.scan(
        np.ascontiguousarray(covariance, np.float32),
        np.ascontiguousarray(present.variance, np.float32),
        lights.row,
        lights.visibility,
        sample.normal,
        (1.0 / sample.albedo**2).astype(np.float32),
        np.array(LEVELS, np.float32),
        np.radians(CAP_DEG) ** 2,
        out,
    )
    return out


def _clearance(
    point: Float32Array, lamp: Float32Array, normal_map: NormalMap, calibration: Calibration
) -> Float32Array:
    """Least slope (K, P) by which each light's ray clears the depth map."""
    known = normal_map.mask & (normal_map.depth > 0)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    corners = _rays_at(
        calibration, np.array([rows[0], rows[0], rows[-1], rows[-1]]), np.array([columns[0], columns[-1]] * 2)
    )
    low, high = corners.min(axis=1), corners.max(axis=1)
    pitch = float(np.max(high - low)) / MAP_SIZE
    size = np.ceil((high - low) / pitch).astype(int) + 3
    first = low - pitch
    grid_x, grid_y = np.meshgrid(first[0] + pitch * np.arange(size[0]), first[1] + pitch * np.arange(size[1]))
    depth_there = np.ones_like(grid_x)
    directions = photometry.points(
        np.stack([grid_x, grid_y]).astype(np.float32), depth_there.astype(np.float32)
    ).reshape(3, -1)
    pixels = photometry.project(calibration, directions.T).reshape(*grid_x.shape, 2).astype(np.float32)
    far = float(normal_map.depth[known].max()) + 0.05
    filled = np.where(known, normal_map.depth, np.float32(far)).astype(np.float32)
    depth = cv2.remap(
        filled, pixels[..., 0], pixels[..., 1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=far
    )
    sign = np.array([1.0, -1.0, -1.0], np.float32)
    out = np.empty((len(lamp), point.shape[1]), np.float32)
    nearest = float(normal_map.depth[known].min())
    kernels.clearance(
        np.ascontiguousarray(depth, np.float32), float(first[0]), float(first[1]), pitch,
        np.ascontiguousarray(point * sign[:, None]), np.ascontiguousarray(lamp[:, :3] * sign), nearest,
        1.5 * pitch * nearest, out,
    )  # fmt: skip
    return out


def _rays_at(calibration: Calibration, rows: np.ndarray, columns: np.ndarray) -> Float32Array:
    pixels = np.stack([columns, rows], axis=-1).astype(np.float64)[:, None, :]
    rays = cv2.undistortPoints(pixels, np.array(calibration.camera_matrix), np.array(calibration.distortion))
    return np.ascontiguousarray(rays[:, 0].T, dtype=np.float32)
