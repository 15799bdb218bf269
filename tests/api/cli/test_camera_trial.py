"""`lightpose camera` on the simulated camera's port, without an arm."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from api.cli.commands import app
from hardware_sim import nominal
from hardware_sim.camera import CameraServer
from tests.acquisition.devices.gige import Clocked

ADDRESS, PIXELS = "127.0.15.40", 32


def noisy(moments: object, exposure_s: float, attempt: int) -> np.ndarray:
    """1000 DN above the black level, noise 5 DN."""
    return (1064 + np.random.default_rng(attempt).normal(0, 5, (PIXELS, PIXELS))).round().astype(np.uint16)


def run(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["camera", *arguments])
    return done.exit_code, done.output


def test_camera_trial_counts_losses_and_measures_noise(tmp_path: Path) -> None:
    cell = nominal.write(tmp_path, ADDRESS, PIXELS, nominal.default_cell_file())
    assert cell.camera.kind == "sim"
    with CameraServer(cell.camera, nominal.calibration(PIXELS), noisy, Clocked()) as server:
        server.faults.order("lost", 2)
        server.faults.order("damaged", 1)
        status, said = run("--cell", str(tmp_path / "cell.toml"), "--count", "12", "--json", "--exposure-s", "0.001")
    assert status == 0, said
    found = json.loads(said.splitlines()[-1])
    assert found["counts"] == {
        "good": 12, "lost": 2, "late": 0, "doubled": 0, "damaged": 1, "settings": 0, "gone": 0, "returned": 0,
        "retaken": 3,
    }  # fmt: skip
    assert len(found["faults"]) == 3
    assert len(found["settings"]) == 1
    assert found["noise_dn"] == pytest.approx(5.0, rel=0.1)
    assert found["level_dn"] == pytest.approx(1000, abs=1)
    assert 0 < found["interval_median_s"] <= found["interval_max_s"]


def test_camera_trial_names_what_is_wrong(tmp_path: Path) -> None:
    cell = nominal.write(tmp_path, ADDRESS, PIXELS, nominal.default_cell_file())
    file = str(tmp_path / "cell.toml")
    status, said = run("--cell", file, "--count", "1")
    assert (status, "camera.unreachable" in said) == (2, True)
    status, said = run("--cell", file, "--exposure-s", "9")
    assert (status, "request.invalid" in said) == (2, True)
    assert cell.camera.kind == "sim"
    with CameraServer(cell.camera, nominal.calibration(2 * PIXELS), noisy, Clocked()):
        status, said = run("--cell", file, "--count", "1")
    assert (status, "config.invalid" in said, "64 × 64 pixels" in said) == (2, True, True)


def test_camera_trial_takes_the_cell_file_as_other_commands_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LIGHTPOSE_CELL", raising=False)
    status, said = run()
    assert (status, "--cell" in said) == (2, True)
    monkeypatch.setenv("LIGHTPOSE_CELL", str(tmp_path / "lab.toml"))
    status, said = run()
    assert (status, "lab.toml" in said) == (2, True)
