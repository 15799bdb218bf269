"""Cell files of simulated cells: which software their controller has."""

from pathlib import Path

import pytest

from hardware_sim import nominal
from hardware_sim.nominal import ROBOT_API_PORT


def test_write_chosen_software_is_in_the_cell_file(tmp_path: Path) -> None:
    given = nominal.default_cell_file()
    x = nominal.write(tmp_path / "x", "127.0.0.9", 64, given, "x").arm
    assert (x.polyscope, x.robot_api_port, x.address) == ("x", ROBOT_API_PORT, "127.0.0.9")
    assert nominal.write(tmp_path / "5", "127.0.0.9", 64, given).arm.polyscope == "5"
    back = nominal.write(tmp_path / "back", "127.0.0.9", 64, tmp_path / "x" / "cell.toml", "5").arm
    assert back.polyscope == "5"


@pytest.mark.parametrize("port", ["", "robot_api_port = 80\n"])
def test_write_real_cell_of_polyscope_x_listens_without_rights(tmp_path: Path, port: str) -> None:
    text = nominal.default_cell_file().read_text(encoding="utf-8")
    real = tmp_path / "real.toml"
    real.write_text(text.replace("[arm]\n", f'[arm]\npolyscope = "x"\n{port}'), encoding="utf-8")
    (tmp_path / "calibration.sim.json").touch()
    arm = nominal.write(tmp_path / "copy", "127.0.0.9", 64, real).arm
    assert (arm.polyscope, arm.robot_api_port) == ("x", ROBOT_API_PORT)
