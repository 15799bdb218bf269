"""The real ur-rtde drives the arm into solid bodies: it stops by itself, and every collision is recorded."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from acquisition.models import cell_config
from hardware_sim import nominal, objects, solids
from hardware_sim.controller.trace import read_trace
from tests.hardware_sim.controller.cells import Cell, connect, restart_program, wait_until

CELL = cell_config.load(nominal.default_cell_file())
HOME = list(CELL.arm.home)
OVER_OBJECT = [2.901, -1.285, 1.882, -2.168, -1.571, -1.811]
"""The tool hangs over the object."""
UPRIGHT = [3.14, -1.57, 1.6, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def surroundings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("solids") / "surroundings.npz"
    solids.surroundings(CELL, objects.build("part", 1).mesh).save(path)
    return path


@pytest.fixture(scope="module")
def record(surroundings: Path) -> Path:
    return surroundings.with_name("ticks.record")


@pytest.fixture(scope="module")
def cell(surroundings: Path, record: Path) -> Iterator[Cell]:
    with ExitStack() as stack:
        yield connect(stack, home=HOME, surroundings=surroundings, speed=4.0, record=record)


def hand(cell: Cell, joints: list[float]) -> None:
    """Somebody puts the arm elsewhere, makes everything normal and starts the program again."""
    with cell.process.control() as control:
        control.fault("program_stop")
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
        control.fault("hand_move", joints=joints, seconds=0.0)
        wait_until(lambda: cell.receive.getActualQ() == pytest.approx(joints))
        control.fault("clear")
    wait_until(lambda: not cell.control.isProgramRunning())
    restart_program(cell)


def collides(cell: Cell, joints: list[float], parts: set[str]) -> None:
    """A move that ends in a protective stop because of these parts."""
    with cell.process.control() as control:
        before = control.state()["collisions"]
        assert not cell.control.moveJ(joints, 1.0, 1.4)
        wait_until(cell.receive.isProtectiveStopped)
        state = control.state()
        assert state["collisions"] > before
        first = control.collisions()[before]
        assert {first["first"], first["second"]} == parts
        assert state["safety_popup"].startswith("PROTECTIVE_STOP: ")
        assert any("COLLISION" in line for line in control.log())
        # It was seen when it began, not where the arm came to rest.
        displacement = max(abs(a - b) for a, b in zip(first["joints"], cell.receive.getActualQ(), strict=True))
        assert displacement < 1.0 * 1.0 / (2 * 15.0) + 0.02
        control.fault("clear")


def test_arm_touching_object_table_or_itself_stops(cell: Cell, record: Path) -> None:
    hand(cell, OVER_OBJECT)
    pose = cell.receive.getActualTCPPose()
    assert not cell.control.moveL([*pose[:2], pose[2] - 0.25, *pose[3:]], 0.25, 1.0)
    wait_until(cell.receive.isProtectiveStopped)
    with cell.process.control() as control:
        last = control.state()["last_collision"]
        assert (last["first"], last["second"]) == ("tool", "object")
        control.fault("clear")
        # Still in contact: it stops again.
        wait_until(lambda: control.state()["safety_mode"] == 3)
        control.fault("clear")
    for begin, goal, parts in (
        ([2.0, *OVER_OBJECT[1:]], [2.0, -0.7, *OVER_OBJECT[2:]], {"tool", "table"}),
        (UPRIGHT, [*UPRIGHT[:2], 2.95, -1.5, *UPRIGHT[4:]], {"upper arm", "wrist 1"}),
    ):
        hand(cell, [float(q) for q in begin])
        collides(cell, [float(q) for q in goal], parts)
    trace = read_trace(record)
    assert trace.touching.any()
    assert {1, 3} <= set(trace.safety_mode.tolist())


@pytest.mark.long
def test_unlock_while_touching_stops_again(cell: Cell) -> None:
    hand(cell, OVER_OBJECT)
    pose = cell.receive.getActualTCPPose()
    assert not cell.control.moveL([*pose[:2], pose[2] - 0.25, *pose[3:]], 0.25, 1.0)
    wait_until(cell.receive.isProtectiveStopped)
    with cell.process.control() as control:
        count = control.state()["collisions"]
        before = control.state()["timestamp"]
        wait_until(lambda: control.state()["timestamp"] > before + 5.1, 8.0)
        cell.dashboard.unlockProtectiveStop()
        wait_until(lambda: control.state()["collisions"] > count)
        assert control.state()["safety_mode"] == 3
        with pytest.raises(RuntimeError, match="5s after occurrence"):
            cell.dashboard.unlockProtectiveStop()
        # Freed by hand it can be unlocked for good.
        control.fault("hand_move", joints=OVER_OBJECT, seconds=0.2)
        wait_until(lambda: control.state()["touching"] is None)
        before = control.state()["timestamp"]
        wait_until(lambda: control.state()["timestamp"] > before + 5.1, 8.0)
        cell.dashboard.unlockProtectiveStop()
        restart_program(cell)
        assert cell.control.moveJ([OVER_OBJECT[0] + 0.05, *OVER_OBJECT[1:]], 1.0, 1.4)
        assert control.state()["safety_mode"] == 1


def test_joint_offset_collides_at_true_position(cell: Cell) -> None:
    hand(cell, OVER_OBJECT)
    pose = cell.receive.getActualTCPPose()
    low = [*pose[:2], pose[2] - 0.02, *pose[3:]]
    assert cell.control.moveL(low, 0.25, 1.0)
    assert cell.control.moveL(pose, 0.25, 1.0)
    with cell.process.control() as control:
        control.fault("joint_offset", offsets_rad=[0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
        assert not cell.control.moveL(low, 0.25, 1.0)
        assert control.state()["last_collision"]["second"] in ("object", "table")
