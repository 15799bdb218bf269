import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hardware_sim import shutter
from hardware_sim.shutter import LAMP_TIME_CONSTANT_S, CellState
from hardware_sim.world import ExposureInterval

REST = (0.1, -1.5, 1.2, -1.0, -1.57, 0.3)


def state(age_s: float, lamp_on: bool = True, shift: float = 0.0, factor: float = 1.0) -> CellState:
    return CellState(tuple(joint + shift for joint in REST), lamp_on, age_s, factor, 0.0)


def moments(states: Sequence[CellState], times: Sequence[float]) -> list[ExposureInterval]:
    """The moments of states at these times of the controller's clock."""
    return shutter.exposure_intervals([replace(state, clock_s=at) for state, at in zip(states, times, strict=True)])


def test_exposure_intervals_resting_arm_and_steady_lamp_are_one() -> None:
    first = moments([state(1.0), state(1.02), state(1.05)], [0.0, 0.02, 0.05])
    second = moments([state(9.0), state(9.06)], [3.0, 3.06])
    assert first == second
    assert (first[0].share, first[0].lamp_level) == (pytest.approx(1.0), 1.0)


def test_exposure_intervals_dark_lamp_is_exactly_zero() -> None:
    assert moments([state(1.0, False), state(1.1, False)], [0.0, 0.1])[0].lamp_level == 0.0


@pytest.mark.parametrize("factor", [1.0, 5.0])
@pytest.mark.parametrize("lamp_on", [True, False])
@pytest.mark.parametrize("age_s", [0.002, 0.01, 0.03])
def test_exposure_intervals_mean_level_is_exponential(factor: float, lamp_on: bool, age_s: float) -> None:
    """The lamp was switched `age_s` before the end of a 20-ms exposure; integrated here by small steps."""
    duration = 0.02
    since_switch = np.linspace(age_s - duration, age_s, 200_001) * factor
    rise = np.where(since_switch > 0, 1 - np.exp(-np.maximum(since_switch, 0) / LAMP_TIME_CONSTANT_S), 0.0)
    expected = np.mean(rise if lamp_on else 1 - rise)
    before = state(
        max(age_s - duration, 0.0) if age_s > duration else 5.0, lamp_on == (age_s > duration), factor=factor
    )
    result = moments([before, state(age_s, lamp_on, factor=factor)], [0.0, duration])
    assert result[0].lamp_level == pytest.approx(expected, abs=shutter.FULL_LEVEL_TOLERANCE + 1e-4)


def test_exposure_intervals_moving_arm_are_few_and_ordered() -> None:
    states = [state(1.0 + k / 100, shift=k / 100) for k in range(41)]
    result = moments(states, [k / 100 for k in range(41)])
    assert 4 <= len(result) <= shutter.MAX_INTERVALS
    assert sum(moment.share for moment in result) == pytest.approx(1.0)
    bases = [moment.joints[0] for moment in result]
    assert bases == sorted(bases)
    assert bases[0] > REST[0]
    assert bases[-1] > REST[0] + 0.3


def test_exposure_intervals_arm_stopping_midway_merge_rest() -> None:
    states = [state(1.0, shift=min(k, 3) / 100) for k in range(9)]
    result = moments(states, [k / 10 for k in range(9)])
    assert result[-1].share == pytest.approx(5 / 8)
    assert result[-1].joints == pytest.approx(tuple(joint + 0.03 for joint in REST))


def test_expose_takes_cell_time() -> None:
    class Source:
        calls = 0

        def state(self) -> CellState:
            self.calls += 1
            now = 0.01 * self.calls
            return replace(state(5.0 + now, factor=4.0), clock_s=now)

    source = Source()
    result = shutter.expose(source, 0.2)
    assert [moment.lamp_level for moment in result] == [1.0]
    assert 3 <= source.calls <= 40


def test_expose_lagging_controller_clock_keeps_lamp_level() -> None:
    """It answers a tenth of a second late, as on a busy machine: the lamp's age and the exposure count by its clock."""

    class Late:
        def state(self) -> CellState:
            on_since = time.monotonic() - begun
            if on_since > 0.02:
                time.sleep(0.05)
            return replace(state(0.02 + on_since, factor=8.0), clock_s=on_since)

    begun = time.monotonic()
    assert [moment.lamp_level for moment in shutter.expose(Late(), 0.05)] == [1.0]
