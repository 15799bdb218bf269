"""Linear image sensor after EMVA 1288: full well, shot and read noise, black level, quantisation.

Photons are not modelled. The calibration's gain converts the signal to electrons, so that the simulated noise follows
the same few numbers as the solver's noise model.
"""

import numpy as np
import numpy.typing as npt

from acquisition.models.base import Float32Array
from acquisition.models.calibration import SensorModel


def expose(signal: Float32Array, sensor: SensorModel, random: np.random.Generator | None) -> npt.NDArray[np.uint16]:
    """Digital values (H, W) uint16 for a signal (H, W) in fractions of full scale; values clip at 1.

    With `random`, shot noise (Poisson) and read noise are added; without, values are only rounded and clipped.
    """
    electrons = np.clip(signal, 0, None) * np.float32(sensor.full_scale_dn * sensor.gain_e_per_dn)
    if random is not None:
        # Capped far above full well, where the number does not matter, so that the generator does not overflow.
        electrons = random.poisson(np.minimum(electrons, 4 * sensor.full_well_e)).astype(np.float32)
    electrons = np.minimum(electrons, np.float32(sensor.full_well_e))
    if random is not None:
        electrons += np.float32(sensor.read_noise_e) * random.standard_normal(electrons.shape, dtype=np.float32)
    values = np.float32(sensor.black_level_dn) + electrons / np.float32(sensor.gain_e_per_dn)
    return np.clip(np.rint(values), 0, 2**sensor.bits - 1).astype(np.uint16)
