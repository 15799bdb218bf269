"""The complete cell: real processes, real sockets, the real `ur-rtde` clients at the controller."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import nominal, truth
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.trace import read_trace

CELL_FILE = nominal.default_cell_file()
PIXELS = 64
LIT = (2.8246, -0.8646, 1.0528, -2.6806, -0.7081, 1.4343)
"""The lamp on the dome, some 30° from the view axis."""


def request(address: str, **fields: Any) -> tuple[dict[str, Any], np.ndarray]:
    with socket.create_connection((address, 30100), 10) as link, link.makefile("rb") as file:
        link.sendall(json.dumps(fields).encode() + b"\n")
        header = json.loads(file.readline())
        assert "error" not in header, header
        pixels = np.frombuffer(file.read(2 * header["width"] * header["height"]), "<u2")
        return header, pixels.reshape(header["height"], header["width"]).astype(float)


def listening(address: str, port: int) -> bool:
    with socket.socket() as link:
        return link.connect_ex((address, port)) == 0


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """A cell whose arm starts with its lamp over the object."""
    folder = tmp_path_factory.mktemp("cell")
    text = nominal.default_cell_file().read_text(encoding="utf-8")
    text = re.sub(r"^home = .*$", f"home = {list(LIT)}", text, flags=re.MULTILINE)
    (folder / "base.toml").write_text(text, encoding="utf-8")
    with Cell(
        CellOptions(
            "127.0.2.30",
            "sphere",
            1,
            "direct",
            5.0,
            pixels=PIXELS,
            cell_file=folder / "base.toml",
            record=folder / "ticks.record",
        ),
        folder / "files",
    ) as cell:
        yield cell


def test_cell_folder_holds_cell_file_calibration_and_truth(cell: Cell) -> None:
    written = cell_config.load(cell.cell_file)
    assert written.arm.address == written.camera.address == "127.0.2.30"
    calibration = cell_config.load_calibration(cell.cell_file.parent / written.calibration)
    assert calibration == nominal.calibration(PIXELS)
    true = truth.load(cell.truth_file)
    assert true.mask.shape == (PIXELS, PIXELS)
    assert 300 < true.mask.sum() < 2000
    assert cell.alive


def test_cell_image_follows_lamp_and_arm(cell: Cell) -> None:
    import rtde_control
    import rtde_io

    mask = truth.load(cell.truth_file).mask
    control = rtde_control.RTDEControlInterface(cell.address)
    outputs = rtde_io.RTDEIOInterface(cell.address)
    try:
        _, dark = request(cell.address, exposure_s=0.05)
        assert abs(dark[mask].mean() - 64) < 1
        assert outputs.setStandardDigitalOut(0, True)
        _wait_for_output(cell.address, 1)
        time.sleep(0.05)
        _, lit = request(cell.address, exposure_s=0.05)
        _, again = request(cell.address, exposure_s=0.05, attempt=0)
        assert lit[mask].mean() > 200
        assert np.array_equal(lit, again)
        # The base turns by 0.3 rad: the light comes from elsewhere.
        assert control.moveJ([LIT[0] + 0.3, *LIT[1:]], 1.0, 1.4)
        _, moved = request(cell.address, exposure_s=0.05)
        assert moved[mask].mean() > 100
        assert np.abs(moved - lit)[mask].mean() > 20
        assert outputs.setStandardDigitalOut(0, False)
        _wait_for_output(cell.address, 0)
        time.sleep(0.05)
        _, off = request(cell.address, exposure_s=0.05)
        assert abs(off[mask].mean() - 64) < 1
    finally:
        control.stopScript()
        control.disconnect()
        outputs.disconnect()


@pytest.mark.long
def test_cell_swaps_object_for_target_while_it_runs(cell: Cell) -> None:
    before = truth.load(cell.truth_file).mask.sum()
    assert cell.place("mirror-sphere") == "mirror-sphere"
    assert truth.load(cell.truth_file).mask.sum() < before  # the ball is half as wide
    known = json.loads((cell.folder / "calibration_truth.json").read_text(encoding="utf-8"))
    assert known["target"] == "mirror-sphere"
    assert known["radius_m"] == pytest.approx(0.025, abs=1e-4)
    with pytest.raises(RigError, match="teapot"):
        cell.place("teapot")
    assert cell.place("sphere") == "sphere"
    assert truth.load(cell.truth_file).mask.sum() == before


def _wait_for_output(address: str, bits: int) -> None:
    with ControlClient(address) as control:
        deadline = time.monotonic() + 60
        while control.state()["digital_outputs"] & 1 != bits:
            assert time.monotonic() < deadline
            time.sleep(0.01)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"spec": "teapot"}, "teapot"),
        ({"profile": "perfect"}, "perfect"),
        ({"speed": 0.0}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"speed": 1e6}, "speed"),
        ({"pixels": 0}, "pixels"),
        ({"pixels": 100_000}, "pixels"),
    ],
)
def test_cell_invalid_option_is_refused_before_start(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    arguments = {"spec": "sphere", "seed": 1, "profile": "ideal", "speed": 1.0, "pixels": 64, **changes}
    with pytest.raises(RigError, match=says) as caught:
        Cell(CellOptions("127.0.2.31", **arguments), tmp_path / "cell")
    assert caught.value.code == ErrorCode.REQUEST_INVALID
    assert not (tmp_path / "cell").exists()


@pytest.mark.parametrize("held", ["cell.toml", "calibration.json"])
def test_cell_files_of_another_cell_are_refused_and_kept(held: str, tmp_path: Path) -> None:
    """As of `lightpose sim --cell copy.toml --folder .` beside a cell's own file: its calibration was measured."""
    measured = nominal.calibration(64).model_copy(update={"made_at": datetime(2026, 11, 30, 9, tzinfo=UTC)})
    content = {"cell.toml": CELL_FILE.read_text(), "calibration.json": measured.model_dump_json()}[held]
    (tmp_path / held).write_text(content)
    with pytest.raises(RigError, match=f"holds {held} of another cell") as caught:
        Cell(CellOptions("127.0.2.31", "sphere", 1, "ideal", 1.0, pixels=64), tmp_path)
    assert caught.value.code == ErrorCode.FOLDER_INVALID
    assert [path.name for path in tmp_path.iterdir()] == [held]
    assert (tmp_path / held).read_text() == content


def test_cell_files_of_a_simulated_cell_are_replaced(tmp_path: Path) -> None:
    """One that did not start, or one with a calibration that its sessions found."""
    for _ in range(2):
        Cell(CellOptions("127.0.2.31", "sphere", 1, "ideal", 1.0, pixels=64), tmp_path)
    (tmp_path / "calibration.json").write_text("{}")
    (tmp_path / "calibration_truth.json").write_text("{}")
    Cell(CellOptions("127.0.2.31", "sphere", 1, "ideal", 1.0, pixels=64), tmp_path)
    assert nominal.is_nominal(tmp_path / "calibration.json")


@pytest.mark.parametrize("record", ["nowhere/ticks", "", "cell.toml/ticks"])
def test_cell_record_that_cannot_be_written_is_named(record: str, tmp_path: Path) -> None:
    """The controller would not start, as if another program used its ports."""
    options = CellOptions("127.0.2.31", "sphere", 1, "ideal", 1.0, pixels=64, record=tmp_path / record)
    with pytest.raises(RigError, match=f"--record .*{record}: cannot be written"), Cell(options, tmp_path):
        pass


def test_cell_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"nowhere\.toml") as caught:
        Cell(CellOptions("127.0.2.31", "sphere", 1, "ideal", 1.0, cell_file=tmp_path / "nowhere.toml"), tmp_path)
    assert caught.value.code == ErrorCode.CONFIG_INVALID


def test_cell_address_in_use_raises_and_leaves_nothing(cell: Cell, tmp_path: Path) -> None:
    with pytest.raises(RigError), Cell(CellOptions(cell.address, "sphere", 1, "ideal", 1.0, pixels=PIXELS), tmp_path):
        pass
    assert cell.alive
    request(cell.address, exposure_s=0.01)


@pytest.mark.long
def test_cell_camera_port_in_use_ends_controller(tmp_path: Path) -> None:
    with socket.create_server(("127.0.2.32", 30100)):
        cell = Cell(CellOptions("127.0.2.32", "sphere", 1, "ideal", 1.0, pixels=PIXELS), tmp_path)
        with pytest.raises(RigError, match="camera's port"), cell:
            pass
    assert not listening("127.0.2.32", 30004)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_cell_processes_end_with_parent(tmp_path: Path, number: signal.Signals) -> None:
    address = "127.0.2.33"
    program = (
        "from pathlib import Path; from hardware_sim import cell;"
        f"cell.run(cell.CellOptions({address!r}, 'part', 1, 'ideal', 1.0, {PIXELS}), folder=Path({str(tmp_path)!r}))"
    )
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline().startswith(b"ready ")
        assert listening(address, 30100)
        assert listening(address, 30004)
        parent.send_signal(number)
        assert parent.wait(60) == (0 if number == signal.SIGTERM else -signal.SIGKILL)
        deadline = time.monotonic() + 60
        while listening(address, 30100) or listening(address, 30004):
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_cell_control_port_orders_lamp_and_camera_faults(cell: Cell) -> None:
    mask = truth.load(cell.truth_file).mask
    with ControlClient(cell.address) as control:
        control.fault("output_stuck", output=0, level=True)
        time.sleep(0.05)
        _, lit = request(cell.address, exposure_s=0.05)
        assert lit[mask].mean() > 100
        control.fault("lamp", fraction=0.0)
        _, dead = request(cell.address, exposure_s=0.05)
        assert abs(dead[mask].mean() - 64) < 1
        assert control.state()["digital_outputs"] & 1
        control.fault("clear")
        control.fault("saturated_frame")
        _, full = request(cell.address, exposure_s=0.05)
        assert np.all(full == 4095)
        control.fault("dropped_frame")
        with socket.create_connection((cell.address, 30100), 10) as link, link.makefile("rb") as file:
            link.sendall(b'{"exposure_s": 0.01}\n')
            assert "lost" in json.loads(file.readline())["error"]
        request(cell.address, exposure_s=0.01)


def test_cell_arm_collides_with_table(cell: Cell) -> None:
    with ControlClient(cell.address) as control:
        assert control.state()["touching"] is None
        control.fault("hand_move", joints=[LIT[0], 0.5, *LIT[2:]], seconds=0.0)
        deadline = time.monotonic() + 60
        while not control.collisions():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert control.collisions()[0]["second"] == "table"
        assert control.state()["safety_mode"] == 3
        control.fault("hand_move", joints=list(LIT), seconds=0.0)
        control.fault("clear")
        count = control.state()["collisions"]
        time.sleep(0.1)
        assert control.state()["collisions"] == count
        assert control.state()["safety_mode"] == 1


@pytest.mark.long
def test_cell_status_lines_follow_state(tmp_path: Path) -> None:
    record = tmp_path / "ticks.record"
    arguments = ["sim", "--address", "127.0.2.34", "--object", "sphere", "--profile", "ideal", "--pixels", str(PIXELS)]
    arguments += ["--calibration-seed", "3", "--json-status", "--record", str(record)]
    with subprocess.Popen([sys.executable, "-m", "api.cli", *arguments], stdout=subprocess.PIPE) as sim:
        assert sim.stdout is not None
        assert sim.stdout.readline().startswith(b"ready ")
        assert json.loads(sim.stdout.readline())["robot_mode"] == "RUNNING"
        with ControlClient("127.0.2.34") as control:
            assert control.state()["calibration_seed"] == 3
            control.fault("emergency_stop")
            reported = json.loads(sim.stdout.readline())
            assert (reported["robot_mode"], reported["safety_mode"]) == ("POWER_OFF", "ROBOT_EMERGENCY_STOP")
        sim.send_signal(signal.SIGTERM)
        assert sim.wait(60) == 0
    trace = read_trace(record)
    assert (trace.safety_mode[0], trace.safety_mode[-1]) == (1, 7)
