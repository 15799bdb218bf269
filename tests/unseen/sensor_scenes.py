"""Sensors of random gain and read noise, with an image of each and its repetition, from which the noise is estimated.

The error is that of the σ of values, which weights measurements and scales the σ of normals. It states in one figure
how wrong gain and read noise are. Where nothing is found, the calibration's statement counts.
"""

from collections.abc import Callable

import cv2
import numpy as np

from acquisition.models.calibration import Calibration, SensorModel
from acquisition.normals.uncertainty import sensor_estimate
from tests.acquisition import scenes
from tests.acquisition.normals.uncertainty.test_sensor_estimate import SIZE, scene, session
from tests.unseen.fresh_process import Errors

GAINS, READ_DN = (0.1, 10.0), (0.5, 20.0)
STATED_SIGMA = 0.3
"""1 σ of the errors of the logarithms of a calibration's gain and read noise."""
PATTERNS = (0.0, 0.0015)
WINDOWS_PX = (64, SIZE)
BLACK_DN = 64.0
LEVELS = 24


def sensor(seed: int) -> Callable[[], Errors]:
    """The frames of a random sensor, as a function that measures the error of its estimated σ."""
    rng = np.random.default_rng([seed, 37])
    known = _sensor(float(_log_uniform(rng, GAINS)), float(_log_uniform(rng, READ_DN)))
    light = scene(rng)
    if seed % 12 == 0:
        light = rng.uniform(0.1, 0.8, light.shape).astype(np.float32)
    grain = cv2.GaussianBlur(rng.normal(size=light.shape).astype(np.float32), (0, 0), float(rng.uniform(1, 8)))
    light = light * (1 + np.float32(rng.uniform(0, 0.1) / np.std(grain)) * grain)
    again = light * (1 + rng.uniform(*PATTERNS) * rng.normal(size=light.shape)).astype(np.float32)
    if seed % 3 == 0:
        away = np.array([[1, 0, rng.uniform(0, 1)], [0, 1, rng.uniform(0, 1)]], np.float32)
        again = cv2.warpAffine(again, away, (SIZE, SIZE), flags=cv2.INTER_CUBIC)
    observations = session(known, np.clip(light, 0, None), seed, again=np.clip(again, 0, None), darks=1 + seed % 2)
    calibration = _stated(known, rng)
    side = int(_log_uniform(rng, WINDOWS_PX))
    window = slice((SIZE - side) // 2, (SIZE + side) // 2)

    def measure() -> Errors:
        found = sensor_estimate.estimate(observations, calibration, window, window).calibration.sensor
        apart = np.abs(np.log(_sigma_dn(found) / _sigma_dn(known)))
        return {"error of the σ of values, %": 100 * float(np.mean(apart))}

    return measure


def _sensor(gain: float, read_dn: float) -> SensorModel:
    full = 2**12 - 1 - BLACK_DN
    return SensorModel(
        bits=12, gain_e_per_dn=gain, read_noise_e=read_dn * gain, full_well_e=full * gain, black_level_dn=BLACK_DN
    )


def _stated(known: SensorModel, rng: np.random.Generator) -> Calibration:
    """A calibration with wrong gain and read noise, and the right values at which pixels clip."""
    gain, read = np.exp(rng.normal(0, STATED_SIGMA, 2)).tolist()
    wrong = {
        "gain_e_per_dn": known.gain_e_per_dn * gain,
        "full_well_e": known.full_well_e * gain,
        "read_noise_e": known.read_noise_e * read * gain,
    }
    return scenes.calibration(SIZE, sensor=known.model_copy(update=wrong))


def _sigma_dn(sensor: SensorModel) -> np.ndarray:
    """1 σ of values at brightnesses from black to full scale, with equally spaced square roots."""
    level = sensor.full_scale_dn * np.linspace(0, 1, LEVELS) ** 2
    return np.sqrt(level / sensor.gain_e_per_dn + (sensor.read_noise_e / sensor.gain_e_per_dn) ** 2)


def _log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))
