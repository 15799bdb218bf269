"""Frames of a simulated sensor at several exposure times: a scene of known brightness, a lamp that scatters, a room."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from acquisition.calibrate.response_frames import ResponseFrame
from acquisition.models.calibration import SensorModel
from acquisition.models.calibration_recipe import ResponseRecipe
from hardware_sim import sensor as simulated

SIZE = (160, 200)


def sensor_of(seed: int) -> SensorModel:
    """A sensor with its own gain, read noise, full well and black level; every second one is full before it clips."""
    random = np.random.default_rng(1000 + seed)
    gain, black = float(random.uniform(0.8, 6)), float(random.uniform(20, 120))
    share = 0.9 if seed % 2 else 1.2
    return SensorModel(
        bits=12, gain_e_per_dn=gain, read_noise_e=float(random.uniform(0.9, 3) * gain),
        full_well_e=share * gain * (4095 - black), black_level_dn=black,
    )  # fmt: skip


def scene(seed: int) -> npt.NDArray[np.float32]:
    """Brightness (H, W), at most 1: soft, with an edge across, and a fixed pattern of 1 %."""
    random = np.random.default_rng(seed)
    rows, columns = np.meshgrid(np.linspace(0, 1, SIZE[0]), np.linspace(0, 1, SIZE[1]), indexing="ij")
    made = 0.15 + 0.8 * rows * (0.6 + 0.4 * np.cos(3 * columns))
    made[:, SIZE[1] // 2 :] *= 0.6
    return (made / made.max() * (1 + 0.01 * random.standard_normal(SIZE))).astype(np.float32)


def frames(
    seed: int, sensor: SensorModel, *, room: float = 0.02, lamp_sigma: float = 0.005, bend: float = 0.0,
    defects: Sequence[tuple[int, int, float]] = (), count: int = 49,
) -> list[ResponseFrame]:  # fmt: skip
    """As a session takes them; `room` of full scale per second, `defects` rows, columns and factors of the response."""
    random, image = np.random.default_rng(seed), scene(seed)
    for row, column, factor in defects:
        image[row, column] *= factor
    made: list[ResponseFrame] = []
    for number, setting in enumerate(ResponseRecipe(kind="response", max_images=count, seed=seed).frames):
        seconds = round(0.1 * setting.share, 6)
        power = setting.share * setting.lit * (1 + lamp_sigma * random.standard_normal())
        signal = power * image + room * seconds * (1 + 0.05 * random.standard_normal())
        signal = (signal * (1 + bend * signal)).astype(np.float32)
        pixels = simulated.expose(signal, sensor, random)
        made.append(ResponseFrame(f"{number}.tiff", seconds, setting.lit, 2.0 * number, _holding(pixels)))
    return made


def _holding(pixels: npt.NDArray[np.uint16]) -> Callable[[], npt.NDArray[np.uint16]]:
    return lambda: pixels


def truth(sensor: SensorModel, bend: float = 0.0) -> npt.NDArray[np.float64]:
    """What `response.estimate` should find: black level, gain, read noise, full well, bend."""
    whole = sensor.full_scale_dn * sensor.gain_e_per_dn
    full = min(sensor.full_well_e, whole)
    # The bend is stated at the level of a full pixel, which here may lie below the converter's range.
    return np.array([sensor.black_level_dn, sensor.gain_e_per_dn, sensor.read_noise_e, full, bend * full / whole])
