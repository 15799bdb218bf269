"""The simulated controller's own wheel: size, standard library only, and its fixture in another project's tests."""

import os
import subprocess
import sys
import textwrap
import zipfile
from pathlib import Path

import pytest

from hardware_sim import ur_sim_project
from hardware_sim.ur_sim_project import NAME, SOURCE

LARGEST_BYTES = 300_000
NUMPY_ONLY = {"contact", "surroundings"}
"""Modules of the extra `collisions`."""

SAMPLE = """
    import pytest
    import rtde_control
    import rtde_receive

    @pytest.mark.ur_controller(model="ur20", speed=20.0)
    def test_move_ends_where_it_was_sent(ur_controller):
        control = rtde_control.RTDEControlInterface(ur_controller.address)
        receive = rtde_receive.RTDEReceiveInterface(ur_controller.address)
        goal = [0.4, -1.7, 1.9, -1.57, -1.57, 0.0]
        assert control.moveJ(goal, 1.0, 2.0)
        assert receive.getActualQ() == pytest.approx(goal, abs=1e-3)
        assert ur_controller.control.state()["model"] == "ur20"
        ur_controller.control.fault("protective_stop")
        assert not control.moveJ([0.0, *goal[1:]], 1.0, 2.0)
        control.disconnect()

    def test_two_arms_have_addresses_of_their_own(start_ur_controller):
        one, two = start_ur_controller(model="ur3e"), start_ur_controller(model="ur30")
        assert one.address != two.address
        assert (one.control.state()["model"], two.control.state()["model"]) == ("ur3e", "ur30")
"""


def run(*command: str | Path, cwd: Path) -> str:
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    environment |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_project_imports_with_standard_library_alone(tmp_path: Path) -> None:
    ur_sim_project.write(tmp_path / "project")
    modules = sorted({file.stem for file in SOURCE.glob("*.py")} - {"__init__", "pytest_plugin", *NUMPY_ONLY})
    code = f"import sys; sys.path.insert(0, {str(tmp_path / 'project')!r})\n"
    code += "".join(f"import {NAME}.{module}\n" for module in modules)
    code += "print(sorted(m for m in ('numpy', 'acquisition', 'hardware_sim') if m in sys.modules))"
    # Neither site-packages nor the environment nor this folder.
    assert run(sys.executable, "-S", "-I", "-c", code, cwd=tmp_path) == "[]\n"


def test_project_files_name_no_module_of_lightpose(tmp_path: Path) -> None:
    ur_sim_project.write(tmp_path / "project")
    for file in (tmp_path / "project" / NAME).glob("*.py"):
        code = [line for line in file.read_text(encoding="utf-8").splitlines() if "import" in line]
        assert not [line for line in code if "hardware_sim" in line or "acquisition" in line], file.name


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_wheel_in_fresh_environment_serves_fixture(tmp_path: Path) -> None:
    ur_sim_project.write(tmp_path / "project")
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", tmp_path, tmp_path / "project", cwd=tmp_path)
    wheel = next(tmp_path.glob("*.whl"))
    assert wheel.stat().st_size <= LARGEST_BYTES
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info" not in name}
    assert {name.partition("/")[0] for name in held} == {NAME}
    files = {file.name for file in SOURCE.iterdir() if file.suffix in (".py", ".toml", ".json")}
    assert files <= {Path(name).name for name in held}
    run(sys.executable, "-m", "venv", tmp_path / "venv", cwd=tmp_path)
    bin_ = tmp_path / "venv" / "bin"
    run(bin_ / "pip", "install", "--quiet", wheel, cwd=tmp_path)
    assert "--model" in run(bin_ / "python", "-m", NAME, "--help", cwd=tmp_path)
    assert "--model" in run(bin_ / "lightpose-ur-sim", "--help", cwd=tmp_path)
    run(bin_ / "pip", "install", "--quiet", "pytest", "ur-rtde", cwd=tmp_path)
    page = (SOURCE.parents[1] / "docs" / "reference" / "ur-sim-package.md").read_text(encoding="utf-8")
    (tmp_path / "test_page.py").write_text(page.split("```python\n")[1].split("```")[0], encoding="utf-8")
    assert "1 passed" in run(bin_ / "python", "-m", "pytest", "-q", "--strict-markers", "test_page.py", cwd=tmp_path)
    (tmp_path / "test_sample.py").write_text(textwrap.dedent(SAMPLE), encoding="utf-8")
    assert "2 passed" in run(bin_ / "python", "-m", "pytest", "-q", "--strict-markers", "test_sample.py", cwd=tmp_path)
