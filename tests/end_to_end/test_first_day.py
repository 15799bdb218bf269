"""A lab's first day as `docs/how-to/calibrate.md` tells it, from the example's cell file to a checked calibration.

The cell file is `deploy/cell.toml` with the page's own sections on board and targets; the commands are the page's.
The person at the terminal is this test: it reads what `lightpose calibrate all` asks for, puts that into the
simulated cell, and answers. The cell's calibration is wrong as one is that was measured with a ruler.
"""

import re
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from hardware_sim import grade_calibration, placing
from hardware_sim.cell import Cell, CellOptions
from tests.end_to_end.processes import Service, client_of, serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]
ROOT = Path(__file__).parents[2]
RUNBOOK = ROOT / "docs" / "how-to" / "calibrate.md"
ADDRESS, SEED, PIXELS = "127.0.6.43", 31, 1024
ASKED = "Is this done, and is nobody within the arm's reach?"
CHOICE = "from now on?"

TARGETS = (
    ("Mount the calibration board", "charuco@flange"),
    ("lay the mirror sphere", "mirror-sphere"),
    ("tilted by 10–20° on a wedge", "matt-plane#1"),
    ("lay the matt plane", "matt-plane"),
)
"""What the command's sentences ask for, and what the simulated stage calls it; the first that fits."""


def described_in(page: Path, section: str) -> str:
    """The TOML block of a page that begins with a section."""
    blocks = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if block.startswith(f"[{section}]")]
    return block


def commands_in(page: Path, heading: str) -> list[list[str]]:
    """Arguments of the `lightpose` commands under a heading of a page, in order."""
    part = page.read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    return [line.split() for line in re.findall(r"^ *\.venv/bin/lightpose (.+)$", part, re.MULTILINE)]


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    """The example's cell file as step 1 and 2 have it written, with the camera that a rehearsal has."""
    example = (ROOT / "deploy" / "cell.toml").read_text(encoding="utf-8")
    camera = f'[camera]\nkind = "sim"\naddress = "{ADDRESS}"\n'
    written, replaced = re.subn(r"^\[camera\]\n(?:.+\n)+", camera, example, flags=re.MULTILINE)
    assert replaced == 1
    file = tmp_path / "first.toml"
    parts = [written, *(described_in(RUNBOOK, section) for section in ("board", "lamp_targets"))]
    file.write_text("\n".join(parts), encoding="utf-8")
    return file


@pytest.fixture
def service(cell_file: Path, tmp_path: Path) -> Generator[Service, None, None]:
    options = CellOptions(ADDRESS, "empty", SEED, "realistic", 20.0, PIXELS, cell_file, perturbed=True)
    with Cell(options, tmp_path / "cell") as cell, serving(cell, tmp_path / "data") as service:
        yield service


def said_by(service: Service, arguments: list[str], folder: Path) -> str:
    """What a command of the page says; it has to end with 0. Targets are put into the cell, and results into use."""
    at_service = [service.url if argument.startswith("http://") else argument for argument in arguments]
    command = [sys.executable, "-m", "api.cli", *at_service]
    running = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=folder,
    )  # fmt: skip
    assert running.stdin is not None
    assert running.stderr is not None
    said, answered = "", 0
    while letter := running.stderr.read(1):  # a question ends without a new line
        said += letter
        if said.endswith(ASKED):
            wanted = said[answered:]
            placing.place(ADDRESS, 30100, next(name for sentence, name in TARGETS if sentence in wanted))
            answered = len(said)
        if said.endswith((ASKED, CHOICE)):
            running.stdin.write("y\n")
            running.stdin.flush()
    assert running.wait() == 0, said
    return said


def test_first_day_from_example_cell_file_ends_with_a_checked_calibration(service: Service, tmp_path: Path) -> None:
    commands = commands_in(RUNBOOK, "A lab's first day")
    by_name = {" ".join(command[:2]): command for command in commands}
    for command in [one for one in commands if one[:2] == ["calibrate", "board"]]:
        said_by(service, command, tmp_path)
    assert sorted(file.name for file in tmp_path.glob("*.pdf")) == ["board.pdf", "plane.pdf"]
    with client_of(service) as client:
        said_by(service, by_name["calibrate all"], tmp_path)
        lamp = next(one for one in client.sessions() if one.recipe.kind == "lamp")
        assert lamp.estimate is not None
        assert lamp.estimate.verified_deg is not None
        assert lamp.estimate.verified_deg < 0.5
        of_lamp = client.calibration().values
        said_by(service, by_name["calibrate response"], tmp_path)
        assert client.calibration().values.sensor != of_lamp.sensor
        said_by(service, by_name["calibrate check"], tmp_path)
        checked = client.rig().calibration.check
        assert list(checked.checks) == ["plane"]
        assert checked.checks["plane"].passed
        errors = grade_calibration.errors(
            client.calibration().values, grade_calibration.load(tmp_path / "cell" / "calibration_truth.json")
        )
    print(errors)
    assert errors.lamp_mm <= 0.5
    assert errors.intensity_percent <= 0.5
    assert errors.lobe_percent <= 1.0
    assert errors.camera_mm <= 0.3
    assert errors.camera_deg <= 0.05
    assert errors.focal_percent <= 0.1
