"""A restart of the service with an interrupted session: the arm is read, and nothing is armed before a resume."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import ENDED, State, Trigger
from api.rest import settings, wiring
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.acquisition.runner.simulated_rig import (
    CELL_FILE,
    LONG,
    Rig,
    acknowledge,
    after_first_image,
    wait_for,
)

ADDRESS = "127.0.6.47"


@contextmanager
def serving(cell: Cell, data: Path, control: ControlClient) -> Generator[Rig, None, None]:
    """The runner of one service after another over the same cell and data."""
    service = wiring.build(settings.read(cell=cell.cell_file, data=data))
    service.open()
    try:
        yield Rig(service.runner, service.store, control)
    finally:
        service.close()


def until(true: Callable[[], bool], rig: Rig, within_s: float = 90.0) -> None:
    deadline = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < deadline, rig.runner.status()
        time.sleep(0.02)


def test_restart_with_interrupted_session_reads_the_arm_and_arms_nothing(tmp_path: Path) -> None:
    options = CellOptions(ADDRESS, "sphere", 1, "ideal", 20.0, pixels=96, cell_file=CELL_FILE)
    with Cell(options, tmp_path / "cell") as cell, ControlClient(cell.address) as control:
        with serving(cell, tmp_path / "data", control) as rig:
            session_id = after_first_image(rig, LONG)
        control.fault("protective_stop")  # while there is no service
        before = control.state()
        with serving(cell, tmp_path / "data", control) as rig:
            assert rig.store.journal.session(session_id).state is State.INTERRUPTED
            until(lambda: rig.runner.status().latched is not None, rig)
            until(lambda: rig.runner.status().camera_ready, rig)
            status = rig.runner.status()
            assert status.reading.connected
            assert status.identity is not None
            assert [reason["code"] for reason in status.reasons][-1] == ErrorCode.RIG_BUSY
            with pytest.raises(RigError) as refused:
                rig.runner.acknowledge("a")
            assert refused.value.code is ErrorCode.SAFETY_STILL_FAULTED
            acknowledge(rig)
            time.sleep(1.0)  # in which a service that took control would have done so
            now = control.state()
            assert not rig.runner.status().reading.program_running
            assert not now["program_running"]
            assert now["moves_started"] == before["moves_started"]
            assert now["joints"] == pytest.approx(before["joints"], abs=1e-6)
            assert now["digital_outputs"] == 0
            rig.runner.act(session_id, Trigger.RESUME, "a")
            assert wait_for(rig, session_id, *ENDED) is State.COMPLETED


def test_signal_whose_thread_starts_late_interrupts_as_a_shutdown(tmp_path: Path) -> None:
    options = CellOptions(ADDRESS, "sphere", 1, "ideal", 20.0, pixels=96, cell_file=CELL_FILE)
    with Cell(options, tmp_path / "cell") as cell, ControlClient(cell.address) as control:
        with serving(cell, tmp_path / "data", control) as rig:
            session_id = after_first_image(rig, LONG)
            until(lambda: max(map(abs, control.state()["joint_speeds"])) > 0.1, rig)
            rig.runner.closing.announced = True  # what the handler does
            rig.runner._rig.halt()
            time.sleep(1.0)  # in which the halt ends the step in progress
            moves = control.state()["moves_started"]
            time.sleep(0.5)
            assert control.state()["moves_started"] == moves
        with serving(cell, tmp_path / "data", control) as rig:
            session = rig.store.journal.session(session_id)
            assert session.state is State.INTERRUPTED
            assert session.reason is not None
            assert session.reason["code"] == ErrorCode.SERVICE_RESTARTED


def test_restart_session_that_is_stopped_leaves_a_rig_that_takes_control(tmp_path: Path) -> None:
    options = CellOptions(ADDRESS, "sphere", 1, "ideal", 20.0, pixels=96, cell_file=CELL_FILE)
    with Cell(options, tmp_path / "cell") as cell, ControlClient(cell.address) as control:
        with serving(cell, tmp_path / "data", control) as rig:
            session_id = after_first_image(rig, LONG)
        with serving(cell, tmp_path / "data", control) as rig:
            until(lambda: rig.runner.status().reading.connected and rig.runner.status().camera_ready, rig)
            assert not control.state()["program_running"]
            rig.runner.halt("a")  # the arm is at rest and uncontrolled: the halt ends the session, and is latched
            assert wait_for(rig, session_id, *ENDED) is State.STOPPED
            assert rig.runner.status().latched is not None
            acknowledge(rig)
            until(lambda: control.state()["program_running"], rig)
