"""Sessions on a simulated UR20: complete, halted, and resumed after a protective stop."""

import re
import socket
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client, ProblemError
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.end_to_end.processes import Service, client_of, rests_after, serving, wait_until_moving
from tests.end_to_end.test_sessions import CELL_FILE, grades, until_state

pytestmark = pytest.mark.long

AWAY_M = 1.0
"""From base to object: a UR20 serves the same dome as the UR5e does at 0.55 m."""


def large_cell_file(folder: Path) -> Path:
    """The test cell with a UR20, its object and camera further away."""
    text = CELL_FILE.read_text(encoding="utf-8").replace('model = "ur5e"', 'model = "ur20"')
    text = re.sub(r"\[0\.55, ", f"[{AWAY_M}, ", text)
    calibration = CELL_FILE.parent / "../../hardware_sim/cells/calibration.sim.json"
    text = re.sub(r"^calibration = .*$", f'calibration = "{calibration.resolve()}"', text, flags=re.MULTILINE)
    (folder / "large.toml").write_text(text, encoding="utf-8")
    return folder / "large.toml"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[tuple[Cell, Service], None, None]:
    folder = tmp_path_factory.mktemp("large")
    options = CellOptions("127.0.6.20", "sphere", 1, "ideal", 8.0, pixels=96, cell_file=large_cell_file(folder))
    with Cell(options, folder / "cell") as running, serving(running, folder / "data") as service:
        yield running, service


def unlock_at_pendant(address: str) -> None:
    """As a person does, who has cleared the cause: until the controller, which refuses it for 5 s, agrees."""
    with socket.create_connection((address, 29999), timeout=60) as connection, connection.makefile("rw") as pendant:
        reply = pendant.readline()  # its greeting
        while not reply.startswith("Protective stop releasing"):
            pendant.write("unlock protective stop\n")
            pendant.flush()
            reply = pendant.readline()


def acknowledge_once_clear(client: Client) -> None:
    """The service reads the controller's state a moment later."""
    deadline = time.monotonic() + 60
    while True:
        try:
            client.acknowledge()
            return
        except ProblemError as error:
            if error.code != ErrorCode.SAFETY_STILL_FAULTED or time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def test_session_on_ur20_completes_without_contact(rig: tuple[Cell, Service]) -> None:
    cell, service = rig
    with client_of(service) as client:
        done = client.capture(Recipe(seed=1), progress=False)
    assert cell.state()["model"] == "ur20"
    assert cell.state()["collisions"] == 0
    assert grades(cell, service.data, done.id)[-1].coverage > 0.95


def test_halt_on_ur20_stops_in_mid_move(rig: tuple[Cell, Service]) -> None:
    cell, service = rig
    with client_of(service) as client, ControlClient(cell.address) as control:
        session = client.create(Recipe())
        client.start(session.id)
        wait_until_moving(control)
        client.halt()
        assert rests_after(control) < 1.0
        until_state(client, session.id, State.STOPPED)
        assert control.state()["digital_outputs"] == 0
        client.acknowledge()


def test_protective_stop_on_ur20_session_resumes(rig: tuple[Cell, Service]) -> None:
    cell, service = rig
    with client_of(service) as client, ControlClient(cell.address) as control:
        session = client.create(Recipe(pilot_lights=3, planned_lights=2))
        client.start(session.id)
        wait_until_moving(control)
        control.fault("protective_stop")
        until_state(client, session.id, State.INTERRUPTED)
        unlock_at_pendant(cell.address)
        acknowledge_once_clear(client)
        client.resume(session.id)
        assert client.wait(session.id).state is State.COMPLETED
        assert control.state()["collisions"] == 0
