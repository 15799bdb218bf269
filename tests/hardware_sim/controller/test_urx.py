"""`urx` 0.11 on the controller, in an environment of its own: it needs a release of math3d that Python 3.9 ran."""

import ast
import re
import subprocess
import venv
from pathlib import Path

import pytest

from tests.hardware_sim.controller.cells import HOME, start, wait_until

pytestmark = pytest.mark.long

PROGRAM = """
import collections, collections.abc, sys, time
collections.Iterable = collections.abc.Iterable  # math3d 3.4.1 looks for it where Python 3.9 had it
import urx

robot = urx.Robot(sys.argv[1])
joints = robot.getj()
target = [q + 0.1 for q in joints]
robot.movej(target, acc=2.0, vel=1.0)
print(max(abs(a - b) for a, b in zip(robot.getj(), target)))
pose = robot.getl()
pose[2] += 0.03
robot.movel(pose, acc=0.5, vel=0.2)
print(max(abs(a - b) for a, b in zip(robot.getl(), pose)))
for level in (True, False):
    robot.set_digital_out(2, level)
    while bool(robot.get_digital_out(2)) is not level:
        robot.secmon.wait()
first = robot.secmon.get_all_data(wait=True)["RobotModeData"]["timestamp"]
for _ in range(20):
    last = robot.secmon.get_all_data(wait=True)["RobotModeData"]["timestamp"]
print((last - first) / 20e6)
robot.close()
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that holds urx."""
    folder = tmp_path_factory.mktemp("urx")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    installed = subprocess.run(
        [python, "-m", "pip", "install", "-q", "urx==0.11.0", "math3d==3.4.1", "numpy"],
        check=False,
        capture_output=True,
        text=True,
    )
    if installed.returncode != 0:
        pytest.skip(f"urx cannot be installed here: {installed.stderr[-300:]}")
    return python


def test_example_of_the_page_runs(python: Path) -> None:
    page = Path("docs/reference/ur-sim-package.md").read_text(encoding="utf-8")
    example = next(
        block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if block.startswith("import urx")
    )
    shim = "import collections, collections.abc\ncollections.Iterable = collections.abc.Iterable\n"
    with start(for_urx=True) as controller:
        code = shim + example.replace("127.0.0.2", controller.address) + "print(robot.getj())\nrobot.close()\n"
        ran = subprocess.run([python, "-c", code], check=False, capture_output=True, text=True, timeout=300.0)
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert ast.literal_eval(ran.stdout) == pytest.approx(HOME, abs=1e-6)


def test_urx_moves_reads_and_switches(python: Path) -> None:
    with start(for_urx=True) as controller:
        ran = subprocess.run(
            [python, "-c", PROGRAM, controller.address], check=False, capture_output=True, text=True, timeout=300.0
        )
        assert ran.returncode == 0, ran.stderr[-2000:]
        joints_error, pose_error, period = map(float, ran.stdout.split())
        with controller.control() as truth:
            wait_until(lambda: not truth.state()["program_running"])
            assert truth.state()["joints"] != HOME
    assert joints_error < 1e-3  # urx sends joints with few digits
    assert pose_error < 1e-3
    assert 0.095 <= period <= 0.35  # s of the controller's clock: 10 Hz, where this reader missed none
