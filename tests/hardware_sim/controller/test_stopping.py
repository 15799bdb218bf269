"""Stops and speeds of the real library, computed from the record of every tick alone."""

import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from hardware_sim.controller.trace import Trace, read_trace
from tests.hardware_sim.controller.cells import HOME, Cell, at_home, connect, let_pass, wait_until

TICK = 0.002
SPEED, ACCELERATION = 1.05, 1.4


def every_tick(trace: Trace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (N, 6), their speeds (N−1, 6) and the places (N, 3) at every tick, none of which may be missing."""
    assert np.all(np.diff(np.round(trace.times / TICK)) == 1)
    return trace.joints, np.diff(trace.joints, axis=0) / TICK, trace.tcp[:, :3]


@dataclass
class Recorded:
    """A cell at home, and the record of its ticks from here on."""

    cell: Cell
    path: Path
    begin: float

    def ticks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What `every_tick` finds since the test has begun."""
        trace = read_trace(self.path)
        rows = trace.times >= self.begin
        assert trace.times[rows][0] == self.begin
        return every_tick(replace(trace, times=trace.times[rows], joints=trace.joints[rows], tcp=trace.tcp[rows]))


@pytest.fixture(scope="module")
def module_cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Cell, Path]]:
    path = tmp_path_factory.mktemp("record") / "ticks.record"
    with ExitStack() as stack:
        yield connect(stack, record=path), path


@pytest.fixture
def recorded(module_cell: tuple[Cell, Path]) -> Iterator[Recorded]:
    cell, path = module_cell
    at_home(cell)
    # The tick at which the client has seen the arm at rest, to the bit; one tick earlier it may still have moved home.
    yield Recorded(cell, path, cell.receive.getTimestamp())
    assert cell.io.setSpeedSlider(1.0)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == 1.0)


@pytest.mark.parametrize("deceleration", [1.5, 6.0])
def test_stopj_in_move_keeps_deceleration(recorded: Recorded, deceleration: float) -> None:
    cell = recorded.cell
    target = [2.0, *HOME[1:]]
    assert cell.control.moveJ(target, SPEED, ACCELERATION, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.999 * SPEED)
    let_pass(cell.receive, 0.1)
    cell.control.stopJ(deceleration)
    assert cell.control.getAsyncOperationProgress() < 0
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    joints, speeds, _ = recorded.ticks()
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


def test_stopl_in_move_stays_on_line(recorded: Recorded) -> None:
    cell = recorded.cell
    pose = cell.receive.getActualTCPPose()
    assert cell.control.moveL([pose[0], pose[1] + 0.25, *pose[2:]], 0.1, 1.0, True)
    wait_until(lambda: math.hypot(*cell.receive.getActualTCPSpeed()[:3]) > 0.0999)
    let_pass(cell.receive, 0.1)
    # The script's first stop is stopj, whatever it is called; after an asynchronous one it is stopl.
    cell.control.stopL(0.5, True)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    _, _, places = recorded.ticks()
    assert np.abs(places - [pose[0], 0.0, pose[2]])[:, [0, 2]].max() < 1e-4
    lead = np.diff(places[:, 1]) / TICK
    full = np.flatnonzero(lead > 0.09999)
    moving = np.flatnonzero(lead > 1e-4)
    assert (moving[-1] - full[-1]) * TICK == pytest.approx(0.1 / 0.5, abs=4 * TICK)


@pytest.mark.parametrize("fraction", [0.25, 0.5])
def test_slider_scales_speed_and_keeps_path(recorded: Recorded, fraction: float) -> None:
    cell = recorded.cell
    assert cell.io.setSpeedSlider(fraction)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == fraction)
    assert cell.control.moveJ([0.1, *HOME[1:]], 1.0, 4.0)
    joints, speeds, _ = recorded.ticks()
    moving = np.flatnonzero(speeds[:, 0])
    expected = 2 * math.sqrt(0.1 / 4.0) / fraction
    assert (moving[-1] - moving[0] + 1) * TICK == pytest.approx(expected, abs=5 * TICK)
    assert speeds[:, 0].max() == pytest.approx(math.sqrt(0.1 * 4.0) * fraction, rel=0.02)
    # In a slower time base accelerations are smaller by the square.
    assert np.abs(np.diff(speeds[:, 0]) / TICK).max() <= 4.0 * fraction**2 * 1.05
    assert joints[-1, 0] == pytest.approx(0.1, abs=1e-12)


def test_slider_at_zero_holds_move_until_raised(recorded: Recorded) -> None:
    cell = recorded.cell
    assert cell.control.moveJ([2.0, *HOME[1:]], 1.0, 4.0, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.5)
    assert cell.io.setSpeedSlider(0.0)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    held = cell.receive.getActualQ()[0]
    assert 0.0 < held < 2.0
    assert cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
    assert cell.io.setSpeedSlider(1.0)
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    joints, speeds, _ = recorded.ticks()
    assert joints[-1, 0] == pytest.approx(2.0, abs=1e-12)
    # The time base fades within 0.2 s: from full speed 5 rad/s², beside the move's own 4.
    assert np.abs(np.diff(speeds[:, 0]) / TICK).max() < 9.5


def test_library_path_is_rounded_at_even_speed(recorded: Recorded) -> None:
    cell = recorded.cell
    corners = [[0.3, *HOME[1:]], [0.3, -1.6, *HOME[2:]], [0.0, -1.6, *HOME[2:]]]
    assert cell.control.moveJ([[*q, 1.0, 3.0, 0.04 if n < 2 else 0.0] for n, q in enumerate(corners)])
    joints, speeds, _ = recorded.ticks()
    assert joints[-1] == pytest.approx(corners[-1], abs=1e-5)
    moving = np.linalg.norm(speeds, axis=1)
    inner = np.flatnonzero(moving > 0.5)
    assert moving[inner[0] : inner[-1]].min() > 0.2
    assert np.abs(np.diff(speeds, axis=0) / TICK).max() <= 2 * 3.0 * 1.01
    stopping = sum(2 * math.sqrt(0.3 / 3.0) for _ in corners)
    assert np.count_nonzero(moving) * TICK < stopping - 0.1
