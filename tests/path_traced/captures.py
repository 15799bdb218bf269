"""Captures of path-traced images: a draw of lamp errors and sensor noise, and what the solver is given of it."""

from dataclasses import dataclass

import numpy as np

from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.light_plan import Light
from acquisition.normals.images.normalised_images import ImageBlock, Images
from tests.path_traced import bench


@dataclass(frozen=True)
class Capture:
    """Solver input of a scene: images, nominal lights, exact camera; and the true log intensities (F,)."""

    stack: Images
    calibration: Calibration
    dn: np.ndarray  # (F, H, W) uint16
    seconds: np.ndarray  # (F,) exposure times at `lamp_intensity` 1
    log_intensity: np.ndarray


SENSOR = SensorModel(bits=12, gain_e_per_dn=10_000 / 4095, read_noise_e=5.0, full_well_e=10_000.0, black_level_dn=0.0)


def calibration(pixels: int, **changes: object) -> Calibration:
    """The camera of the renders; what it says of its own uncertainty is 1 % and 1 mm unless changed."""
    focal, middle = bench.focal_px(pixels), pixels / 2 - 0.5
    values: dict[str, object] = {
        "width": pixels,
        "height": pixels,
        "camera_matrix": ((focal, 0.0, middle), (0.0, focal, middle), (0.0, 0.0, 1.0)),
        "distortion": (0.0, 0.0, 0.0, 0.0, 0.0),
        "base_from_camera": ((1.0, 0, 0, 0), (0.0, -1, 0, 0), (0.0, 0, -1, bench.TABLE_DEPTH_M), (0.0, 0, 0, 1)),
        "tool_from_lamp": ((1.0, 0, 0, 0), (0.0, 1, 0, 0), (0.0, 0, 1, 0), (0.0, 0, 0, 1)),
        "lamp_intensity": 1.0,
        "reference_m": bench.REFERENCE_M,
        "lobe_exponent": 0.0,
        "sensor": SENSOR,
        "intensity_sigma": 0.01,
        "lamp_position_sigma_m": 0.001,
        "made_at": "2026-01-01T00:00:00Z",
        "valid_days": 100.0,
    }
    values.update(changes)
    return Calibration(**values)


def capture(
    y: np.ndarray, light_positions: np.ndarray, seed: int, *, intensity_sigma: float = 0.01,
    position_sigma_m: float = 0.001, known: Calibration | None = None,
) -> Capture:  # fmt: skip
    """One draw of lamp errors and sensor noise on images y (F, H, W); the solver gets the nominal lights."""
    rng = np.random.default_rng(1000 + seed)
    pixels = y.shape[-1]
    known = known or calibration(pixels)
    log_intensity = rng.normal(0, intensity_sigma, len(y))
    nominal = light_positions + rng.normal(0, position_sigma_m, light_positions.shape)
    lit = np.max(y, axis=0) > 0
    seconds = np.array([0.8 / np.percentile(one[lit], 99.5) for one in y])
    signal = y * np.exp(log_intensity)[:, None, None] * seconds[:, None, None]
    electrons = rng.poisson(signal * SENSOR.full_well_e) + rng.normal(0, SENSOR.read_noise_e, y.shape)
    dn = np.clip(np.round(electrons / SENSOR.gain_e_per_dn), 0, 2**SENSOR.bits - 1).astype(np.uint16)
    axis = bench.CENTER - nominal
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    scale = SENSOR.full_scale_dn * seconds
    stack = Images(
        read=ImageBlock((dn / scale[:, None, None]).astype(np.float32), dn >= 0.985 * SENSOR.full_scale_dn).rows,
        lights=tuple(
            Light(position=tuple(one.tolist()), axis=tuple(look.tolist()))
            for one, look in zip(nominal, axis, strict=True)
        ),
        rows=slice(0, pixels),
        columns=slice(0, pixels),
        shot=1 / (SENSOR.full_well_e * seconds),
        floor=(SENSOR.read_noise_e**2 + SENSOR.gain_e_per_dn**2 / 12) / (SENSOR.full_well_e * seconds) ** 2,
    )  # fmt: skip
    return Capture(stack, known, dn, seconds, log_intensity)
