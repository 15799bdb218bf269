"""Clients written elsewhere, unmodified, each in an environment that the test makes: their read and move calls.

`urkit` 0.6.0 and `universal-robots-clients` 0.4.0 are built on ur-rtde; both name what they read after it.
"""

import json
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from tests.hardware_sim.controller.cells import HOME, start

URKIT = """
robot = URRobot(ip=address)
said["joints"], said["force"] = robot.get_joint_positions(), robot.get_tcp_force()
robot.set_payload(1.0, [0, 0, 0.05])
robot.set_digital_output(3, True)
before = robot.get_current_point()
robot.move_relative(dz=0.05, vel=0.2, acc=0.5)
said["risen"] = robot.get_current_point()[2] - before[2]
robot.move_to([-0.30, -0.133, 0.45, 2.22, 2.22, 0.0], vel=0.3, acc=0.8)
said["line"] = robot.get_current_point()
robot.move_to([-0.35, -0.133, 0.45, 2.22, 2.22, 0.0], linear=False, vel=0.3, acc=0.8)
said["joint_move"] = robot.get_current_point()
said["output"] = robot.get_digital_output(3)
robot.stop()
"""
CLIENTS = """
rtde.configure(address)
names = "actual_joint_positions actual_tcp_pose actual_tcp_speed actual_tcp_force joint_temperatures robot_mode"
for name in (names + " safety_mode runtime_state speed_scaling_percent").split():
    said[name] = getattr(rtde, "read_" + name)()
said["faults"] = [rtde.is_emergency_stopped(), rtde.is_protective_stopped()]
rtde.write_speed_slider_percent(50.0)
rtde.write_tool_digital_output(0, True)
rtde.write_input_int_register(42, 7)
deadline = time.monotonic() + 60.0
while not (rtde.read_tool_digital_output(0) and rtde.read_speed_slider_percent() == 50.0):
    assert time.monotonic() < deadline
    time.sleep(0.01)
said["state"], said["stop"] = dashboard.get_program_state(address), dashboard.stop_program(address)
"""


def run(folder: Path, packages: list[str], imports: str, code: str) -> dict[str, Any]:
    """Runs a client against a controller in an environment of its own; what it said."""
    python = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    command = [str(python), "-m", "pip", "install", "-q", *packages]
    installed = subprocess.run(command, check=False, capture_output=True, text=True)
    if installed.returncode != 0:
        pytest.skip(f"no registry gives {packages}: {installed.stderr[-200:]}")
    program = f"import json, os, sys, time\n{imports}\naddress, said = sys.argv[1], {{}}\n{textwrap.dedent(code)}"
    # Left without the destructors of ur-rtde, which wait for threads.
    program += "\nprint('SAID', json.dumps(said), flush=True)\nos._exit(0)\n"
    with start() as process:
        command = [str(python), "-c", program, process.address]
        result = subprocess.run(
            [str(python), "-c", program, process.address],
            check=False,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=300,
        )
    said = [line for line in result.stdout.splitlines() if line.startswith("SAID ")]
    assert said, result.stderr
    answer: dict[str, Any] = json.loads(said[0][5:])
    return answer


@pytest.mark.long
@pytest.mark.timeout(900)
def test_urkit_reads_and_moves(tmp_path: Path) -> None:
    said = run(tmp_path, ["urkit==0.6.0"], "from urkit import URRobot", URKIT)
    assert said["joints"] == pytest.approx(HOME)
    assert said["force"] == [0.0] * 6
    assert said["risen"] == pytest.approx(0.05, abs=1e-6)
    assert said["line"] == pytest.approx([-0.30, -0.133, 0.45, 2.22, 2.22, 0.0], abs=1e-6)
    assert said["joint_move"] == pytest.approx([-0.35, -0.133, 0.45, 2.22, 2.22, 0.0], abs=1e-6)
    assert said["output"] is True


@pytest.mark.long
@pytest.mark.timeout(900)
def test_universal_robots_clients_reads_and_writes(tmp_path: Path) -> None:
    imports = "from universal_robots_clients import dashboard_client as dashboard, rtde_client as rtde"
    said = run(tmp_path, ["universal-robots-clients[rtde]==0.4.0"], imports, CLIENTS)
    assert said["actual_joint_positions"] == pytest.approx(HOME)
    assert len(said["actual_tcp_pose"]) == 6
    assert (said["robot_mode"], said["safety_mode"], said["runtime_state"]) == (7, 1, 1)
    assert said["faults"] == [False, False]
    assert said["state"].startswith("STOPPED")
    assert said["stop"] == "Stopped"
