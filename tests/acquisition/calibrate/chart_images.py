"""Images of the simulated chart under a near lamp, by seeds."""

import numpy as np

from acquisition import geometry
from acquisition.calibrate.chart_reference import ChartReference, published
from acquisition.models.calibration import SensorModel
from hardware_sim import spectra
from hardware_sim.render import Lamp, Lens
from tests.acquisition.calibrate.simulated_chart import PITCH_M, ColourChart

SENSOR = SensorModel(
    bits=12, gain_e_per_dn=2.5, read_noise_e=5.0, full_well_e=10077.5, black_level_dn=64.0, mosaic="rggb"
)
CELL = np.array([[0, 1], [1, 2]], np.uint8)
EXPOSURE = 0.75
"""Fraction of full scale of a mean white that faces the lamp; green is 1.18 times as bright."""


def reference() -> ChartReference:
    """What a spectrophotometer would state of the simulated chart."""
    return ChartReference(published().names, spectra.chart_lab(), "the simulated chart")


def frame(seed: int, size: int = 320) -> np.ndarray:
    """One image (H, W): chart laid down anyhow, the lamp half a metre away, up to 35° off the normal."""
    random = np.random.default_rng([71, seed])
    turn = geometry.pose((0.0, 0.0, 0.0), (0.0, 0.0, random.uniform(-np.pi, np.pi)))
    tilt = geometry.pose((0.0, 0.0, 0.0), random.uniform(-0.08, 0.08, 3) * (1, 1, 0))
    upright = geometry.pose((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0))
    pose = tilt @ upright @ turn
    middle = pose[:3, :3] @ np.array([2.5 * PITCH_M, 1.5 * PITCH_M, 0.0])
    pose[:3, 3] = -middle + np.array([*random.uniform(-0.004, 0.004, 2), 0.01])
    focal = 0.9 * size * 0.5 / 0.065
    lens = Lens(
        size, size, np.array([[focal, 0, size / 2 - 0.5], [0, focal, size / 2 - 0.5], [0, 0, 1]]),
        np.array([-0.05, 0.02, 0, 0, 0]), geometry.pose((0, 0, 0.9), (np.pi, 0, 0)),
    )  # fmt: skip
    slant, azimuth = random.uniform(0.2, 0.6), random.uniform(0, 2 * np.pi)
    place = 0.45 * np.array([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.cos(slant)])
    lamp = Lamp(place, -place / np.linalg.norm(place), 1.0, 0.45, 0.8)
    return ColourChart(pose).frame(lens, lamp, SENSOR, CELL, EXPOSURE, random)
