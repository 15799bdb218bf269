"""Parking: the arm returns home from any joints, through the runner and the simulated controller."""

import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from acquisition.models.base import Joints
from acquisition.models.errors import ErrorCode, RigError
from acquisition.runner.runner import Runner
from acquisition.session import same_joints
from acquisition.store import Store
from api.rest import settings, wiring
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient

ADDRESS = "127.0.13.20"
CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"


@dataclass(frozen=True)
class Rig:
    runner: Runner
    store: Store
    control: ControlClient
    home: Joints

    def outcome(self) -> str:
        """Outcome of the newest parking; waits for it."""
        deadline = time.monotonic() + 90
        while True:
            ended = list(self.store.journal.events(0, types=("rig.parked",)))
            if len(ended) > self.handled:
                object.__setattr__(self, "handled", len(ended))
                return str(ended[-1].body["outcome"])
            assert time.monotonic() < deadline, "parking did not end"
            time.sleep(0.02)

    handled: int = 0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    folder = tmp_path_factory.mktemp("park")
    with Cell(CellOptions(ADDRESS, "sphere", 1, "ideal", 4.0, pixels=64, cell_file=CELL_FILE), folder / "cell") as cell:
        service = wiring.build(settings.read(cell=cell.cell_file, data=folder / "data"))
        service.open()
        with ControlClient(cell.address) as control:
            yield Rig(service.runner, service.store, control, service.cell.arm.home)
        service.close()


def park(rig: Rig) -> None:
    """Starts parking; a link that the busy machine has interrupted is acknowledged before, as an operator does."""
    deadline = time.monotonic() + 60
    while True:
        try:
            rig.runner.moves.park("a")
        except RigError as error:
            lost = error.code in (ErrorCode.DEVICE_DISCONNECTED, ErrorCode.SAFETY_NOT_ACKNOWLEDGED)
            if not lost or time.monotonic() > deadline:
                raise
            time.sleep(0.05)
            with suppress(RigError):  # refused as long as the link is away
                rig.runner.acknowledge("a")
            continue
        return


def left_at(rig: Rig, joints: tuple[float, ...]) -> None:
    """Somebody stops the program at the pendant, moves the arm by hand, and says that all is clear."""
    rig.control.fault("program_stop")
    rig.control.fault("hand_move", joints=list(joints), seconds=0.0)
    rig.control.fault("clear")
    deadline = time.monotonic() + 60
    while not same_joints(rig.runner.status().reading.joints, joints):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    rig.runner.acknowledge("a")


def test_park_displaced_arm_returns_home(rig: Rig) -> None:
    park(rig)
    assert rig.outcome() == "at home"
    left_at(rig, (rig.home[0] + 1.2, rig.home[1] - 0.3, *rig.home[2:5], rig.home[5] + 0.5))
    park(rig)
    assert rig.outcome() == "at home"
    assert same_joints(tuple(rig.control.state()["joints"]), rig.home)
    assert rig.control.state()["collisions"] == 0


def test_park_stop_halts_the_arm(rig: Rig) -> None:
    left_at(rig, (rig.home[0] + 2.5, *rig.home[1:]))
    rig.control.fault("speed_slider", fraction=0.2)  # several seconds away, however busy the machine is
    park(rig)
    deadline = time.monotonic() + 60
    while max(map(abs, rig.control.state()["joint_speeds"])) < 0.1:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    rig.runner.halt("b")
    assert rig.outcome().startswith("halted")
    before = rig.control.state()["joints"]
    time.sleep(0.3)
    assert rig.control.state()["joints"] == before
    rig.control.fault("speed_slider", fraction=1.0)
    assert not same_joints(tuple(before), rig.home)
    with pytest.raises(RigError) as refused:
        rig.runner.moves.park("a")
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    park(rig)
    assert rig.outcome() == "at home"


def test_park_without_free_path_raises_collision(rig: Rig) -> None:
    near_the_table = (rig.home[0] + 1.5, -0.135, 0.3, 0.0, 0.0, 0.0)  # 9 mm above it
    left_at(rig, near_the_table)
    with pytest.raises(RigError) as refused:
        park(rig)
    assert refused.value.code is ErrorCode.WAYPOINTS_COLLISION
    assert "by hand" in refused.value.detail
    assert same_joints(tuple(rig.control.state()["joints"]), near_the_table)
