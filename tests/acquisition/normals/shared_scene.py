"""Synthetic measurements by the image-formation model, for the parameters that all pixels share: lamps, lobe, noise."""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.calibration import Calibration
from acquisition.normals.pixels.pixel_solve import Pixels, Scene
from tests.acquisition import scenes
from tests.path_traced import bench

DEPTH_M = 0.9


@dataclass(frozen=True)
class MeasuredPixels:
    """K pixels of one depth with normals spread over a cap, lit by two rings; `values` (F, K) without noise."""

    pixels: Pixels
    depth_m: np.ndarray
    ray_direction: np.ndarray
    light: np.ndarray
    normals: np.ndarray
    lamp: np.ndarray
    calibration: Calibration
    noise: Noise

    @property
    def scene(self) -> Scene:
        return Scene(self.lamp, self.calibration, self.noise)

    @property
    def values(self) -> np.ndarray:
        return self.pixels.values


def measured(count: int = 8, size: int = 40, largest_slant: float = 0.6, albedo: float = 0.6) -> MeasuredPixels:
    rng = np.random.default_rng(5)
    known = scenes.calibration(size, lobe_exponent=0.0)
    ray = photometry.rays(known, slice(0, size), slice(0, size)).reshape(2, -1)
    depth = np.full(ray.shape[1], DEPTH_M, np.float32)
    point, ray_direction = photometry.points(ray, depth), photometry.ray_directions(ray)
    center = np.array([0, 0, -DEPTH_M])
    places = bench.two_rings(count) - bench.CENTER + center
    lamp = np.concatenate([places, (center - places) / 0.45], axis=1).astype(np.float32)
    light = photometry.light_vectors(np.ascontiguousarray(point), lamp, known)
    slant, azimuth = largest_slant * np.sqrt(rng.random(ray.shape[1])), 2 * np.pi * rng.random(ray.shape[1])
    normals = np.stack([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.cos(slant)])
    values = albedo * np.maximum(np.einsum("fcn,cn->fn", light, normals), 0)
    pixels = Pixels((size, size), np.arange(size * size), ray, values.astype(np.float32), np.zeros(values.shape, bool))
    noise = Noise(np.full(count, 1e-6), np.full(count, 1e-7), 0.01, 0.004)
    return MeasuredPixels(pixels, depth, ray_direction, light, normals.astype(np.float32), lamp, known, noise)
