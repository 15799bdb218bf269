"""The response's estimate on frames of a simulated sensor: coverage, defective pixels, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.calibrate import response
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.calibrate import simulated_response as simulated
from tests.acquisition.calibrate.coverage import MOST, require_covered


def errors_in_sigma(seed: int) -> np.ndarray:
    """Errors (5,) of the found values over their stated 1 σ."""
    sensor, bend = simulated.sensor_of(seed), (0.0, -0.03, 0.02)[seed % 3]
    found = response.estimate(simulated.frames(seed, sensor, bend=bend), sensor.bits)
    return (found.values - simulated.truth(sensor, bend)) / np.sqrt(np.diag(found.covariance))


def test_response_finds_sensor_room_and_defects() -> None:
    sensor = simulated.sensor_of(1)
    defects = [(20, 30, 0.2), (100, 150, 3.0)]
    found = response.estimate(simulated.frames(1, sensor, defects=defects), sensor.bits)
    assert found.full == "pixel"
    assert found.values == pytest.approx(simulated.truth(sensor), rel=0.03, abs=0.005)
    assert found.room[0] == pytest.approx(
        0.02 / 0.9, rel=0.15
    )  # of a full pixel, which is 0.9 of the converter's range
    assert found.lamp_sigma == pytest.approx(0.005, rel=0.5)
    assert {(row, column) for column, row, _ in found.defects} == {(20, 30), (100, 150)}


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_response_values_lie_in_their_intervals() -> None:
    errors = np.array([errors_in_sigma(seed) for seed in range(50)])
    for name, of_value in zip(("black level", "gain", "read noise", "full well", "bend"), errors.T, strict=True):
        require_covered(name, (of_value**2).tolist(), 1, most=1.0)
    assert np.mean(np.abs(errors) < 1.96) <= MOST


def test_response_without_lamp_is_refused() -> None:
    sensor = simulated.sensor_of(0)
    frames = simulated.frames(0, sensor)
    darks = {frame.exposure_s: frame for frame in frames if not frame.lit}
    off = [replace(frame, read=darks.get(frame.exposure_s, frame).read) for frame in frames]
    with pytest.raises(RigError, match="lamp") as refused:
        response.estimate(off, sensor.bits)
    assert refused.value.code is ErrorCode.CALIBRATION_INFEASIBLE


def test_response_of_single_frames_is_refused() -> None:
    sensor = simulated.sensor_of(0)
    frames = simulated.frames(0, sensor)
    seen: set[tuple[float, bool]] = set()
    once = [one for one in frames if not ((one.exposure_s, one.lit) in seen or seen.add((one.exposure_s, one.lit)))]
    with pytest.raises(RigError, match="two frames") as refused:
        response.estimate(once, sensor.bits)
    assert refused.value.code is ErrorCode.CALIBRATION_INFEASIBLE
