"""Stops and speeds of the real library, computed from the record of every tick alone."""

import math
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from hardware_sim.controller.trace import Trace, read_trace
from tests.hardware_sim.controller.cells import HOME, Cell, connect, wait_until

TICK = 0.002
SPEED, ACCELERATION = 1.05, 1.4


def every_tick(trace: Trace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (N, 6), their speeds (N−1, 6) and the places (N, 3) at every tick: rows that are left out repeat."""
    ticks = np.round(trace.times / TICK).astype(int)
    rows = np.searchsorted(ticks, np.arange(ticks[0], ticks[-1] + 1), side="right") - 1
    joints = trace.joints[rows]
    return joints, np.diff(joints, axis=0) / TICK, trace.tcp[rows, :3]


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Cell, Path, ExitStack]:
    path = tmp_path / "ticks.record"
    stack = ExitStack()
    return connect(stack, record=path), path, stack


def finished(recorded: tuple[Cell, Path, ExitStack]) -> Trace:
    _, path, stack = recorded
    stack.close()
    return read_trace(path)


@pytest.mark.parametrize("deceleration", [1.5, 6.0])
def test_stop_in_mid_move_obeys_its_deceleration(recorded: tuple[Cell, Path, ExitStack], deceleration: float) -> None:
    cell = recorded[0]
    target = [2.0, *HOME[1:]]
    assert cell.control.moveJ(target, SPEED, ACCELERATION, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.999 * SPEED)
    time.sleep(0.1)
    cell.control.stopJ(deceleration)
    assert cell.control.getAsyncOperationProgress() < 0
    joints, speeds, _ = every_tick(finished(recorded))
    lead = speeds[:, 0]
    assert lead.max() == pytest.approx(SPEED, rel=1e-6)
    begin = int(np.flatnonzero(lead > 0.999999 * SPEED)[-1])
    moving = int(np.flatnonzero(lead > 0)[-1])
    # From full speed to rest in v/a, over v²/2a, at an even deceleration.
    assert (moving - begin) * TICK == pytest.approx(SPEED / deceleration, abs=2 * TICK)
    assert joints[-1, 0] - joints[begin, 0] == pytest.approx(SPEED**2 / (2 * deceleration), abs=3 * TICK * SPEED)
    braking = np.diff(lead)[begin + 1 : moving - 1] / TICK
    assert braking == pytest.approx(np.full(len(braking), -deceleration), rel=1e-6)
    assert np.abs(speeds[:, 1:]).max() == 0.0


def test_stop_of_the_tool_in_mid_move_stays_on_its_line(recorded: tuple[Cell, Path, ExitStack]) -> None:
    cell = recorded[0]
    pose = cell.receive.getActualTCPPose()
    assert cell.control.moveL([pose[0], pose[1] + 0.25, *pose[2:]], 0.25, 1.0, True)
    wait_until(lambda: math.hypot(*cell.receive.getActualTCPSpeed()[:3]) > 0.2499)
    time.sleep(0.1)
    # The script's first stop is stopj, whatever it is called; after an asynchronous one it is stopl.
    cell.control.stopL(2.0, True)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    _, _, places = every_tick(finished(recorded))
    assert np.abs(places - [pose[0], 0.0, pose[2]])[:, [0, 2]].max() < 1e-4
    lead = np.diff(places[:, 1]) / TICK
    full = np.flatnonzero(lead > 0.2499)
    moving = np.flatnonzero(lead > 1e-4)
    assert (moving[-1] - full[-1]) * TICK == pytest.approx(0.25 / 2.0, abs=3 * TICK)


@pytest.mark.parametrize("fraction", [0.25, 0.5])
def test_slider_scales_speed_and_not_the_way(recorded: tuple[Cell, Path, ExitStack], fraction: float) -> None:
    cell = recorded[0]
    assert cell.io.setSpeedSlider(fraction)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == fraction)
    assert cell.control.moveJ([0.1, *HOME[1:]], 1.0, 4.0)
    joints, speeds, _ = every_tick(finished(recorded))
    moving = np.flatnonzero(speeds[:, 0])
    expected = 2 * math.sqrt(0.1 / 4.0) / fraction
    assert (moving[-1] - moving[0] + 1) * TICK == pytest.approx(expected, abs=2 * TICK)
    assert speeds[:, 0].max() == pytest.approx(math.sqrt(0.1 * 4.0) * fraction, rel=0.02)
    # In a slower time base accelerations are smaller by the square.
    assert np.abs(np.diff(speeds[:, 0]) / TICK).max() <= 4.0 * fraction**2 * 1.05
    assert joints[-1, 0] == pytest.approx(0.1, abs=1e-12)


def test_slider_at_zero_holds_the_move_until_it_is_raised(recorded: tuple[Cell, Path, ExitStack]) -> None:
    cell = recorded[0]
    assert cell.control.moveJ([0.5, *HOME[1:]], 1.0, 4.0, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.5)
    assert cell.io.setSpeedSlider(0.0)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    held = cell.receive.getActualQ()[0]
    assert 0.0 < held < 0.5
    assert cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
    assert cell.io.setSpeedSlider(1.0)
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    joints, speeds, _ = every_tick(finished(recorded))
    assert joints[-1, 0] == pytest.approx(0.5, abs=1e-12)
    # The time base fades within 0.2 s: from full speed 5 rad/s², beside the move's own 4.
    assert np.abs(np.diff(speeds[:, 0]) / TICK).max() < 9.5


def test_path_of_the_library_is_rounded_and_even(recorded: tuple[Cell, Path, ExitStack]) -> None:
    cell = recorded[0]
    corners = [[0.3, *HOME[1:]], [0.3, -1.6, *HOME[2:]], [0.0, -1.6, *HOME[2:]]]
    assert cell.control.moveJ([[*q, 1.0, 3.0, 0.04 if n < 2 else 0.0] for n, q in enumerate(corners)])
    joints, speeds, _ = every_tick(finished(recorded))
    assert joints[-1] == pytest.approx(corners[-1], abs=1e-5)
    moving = np.linalg.norm(speeds, axis=1)
    inner = np.flatnonzero(moving > 0.5)
    assert moving[inner[0] : inner[-1]].min() > 0.2
    assert np.abs(np.diff(speeds, axis=0) / TICK).max() <= 2 * 3.0 * 1.01
    stopping = sum(2 * math.sqrt(0.3 / 3.0) for _ in corners)
    assert np.count_nonzero(moving) * TICK < stopping - 0.1
