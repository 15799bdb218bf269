"""The wheel: its content, and that it runs without a checkout."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

ROOT = Path(__file__).parents[1]
PACKAGES = ("acquisition", "api", "hardware_sim")


def run(*command: str | Path, cwd: Path) -> str:
    """What a command prints, run with no PYTHONPATH; AssertionError with its complaint when it fails."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    environment |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy: setuptools would put what an earlier build left beside the sources into it."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
    for file in ROOT.iterdir():
        if file.is_file() and not file.name.startswith("."):
            shutil.copy(file, source)
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", folder, source, cwd=folder)
    return next(folder.glob("*.whl"))


def test_wheel_content_has_each_tracked_file_of_the_packages(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    tracked = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    not_python = {name for name in tracked if name.startswith("api/page/") and not name.startswith("api/page/built/")}
    assert set(tracked) - not_python - held == set()  # of the operator's page users need the bundle, not its sources
    assert {f"{package}/py.typed" for package in PACKAGES} <= held
    assert {name.partition("/")[0] for name in held if ".dist-info" not in name} == set(PACKAGES)


def test_wheel_in_fresh_environment_runs_demo(wheel: Path, tmp_path: Path) -> None:
    run(sys.executable, "-m", "venv", tmp_path / "venv", cwd=tmp_path)
    bin_ = tmp_path / "venv" / "bin"
    constraints = ROOT / "deploy" / "constraints.txt"
    run(bin_ / "pip", "install", "--quiet", "--constraint", constraints, f"{wheel}[sim]", cwd=tmp_path)
    where = run(bin_ / "python", "-c", "import acquisition; print(acquisition.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(tmp_path)
    run(bin_ / "lightpose", "warm", cwd=tmp_path)
    run(bin_ / "lightpose", "check", "--offline", cwd=tmp_path)
    arguments = ["--json", "--pixels", "128", "--object", "sphere", "--data", tmp_path / "demo"]
    figures = json.loads(run(bin_ / "lightpose", "demo", *arguments, cwd=tmp_path).splitlines()[-1])
    assert figures["coverage"] > 0.95
    assert figures["mean_deg"] < 3.0
