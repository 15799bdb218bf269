"""Valid and invalid user scripts through `sendCustomScript` and its variants."""

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.hardware_sim.controller.cells import HOME, Cell, at_home, connect, send_script, start, wait_until

NEAR = [0.05, *HOME[1:]]


@pytest.fixture(scope="module")
def module_cell() -> Iterator[Cell]:
    with ExitStack() as stack:
        yield connect(stack)


@pytest.fixture
def cell(module_cell: Cell) -> Cell:
    at_home(module_cell)
    return module_cell


def log(cell: Cell) -> str:
    with cell.process.control() as control:
        return "\n".join(control.log())


def test_custom_script_function_runs_and_control_resumes(cell: Cell) -> None:
    lines = """\tglobal total = 0
\tthread adder():
\t\twhile True:
\t\t\tenter_critical
\t\t\ttotal = total + 1
\t\t\texit_critical
\t\t\tsync()
\t\tend
\tend
\thandle = run adder()
\tstate = struct(goal=[0.05, -1.9, 1.9, -1.57, -1.57, 0], speed=1.5)
\tmovej(state.goal, a=10, v=state.speed)
\tkill handle
\tif total > 10 and not False:
\t\twrite_output_float_register(20, total)
\tend
"""
    assert cell.control.sendCustomScriptFunction("users", lines)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(NEAR, abs=1e-9))
    wait_until(cell.control.isProgramRunning)
    assert cell.control.moveJ(HOME, 3.0, 20.0)
    assert "program users started" in log(cell)


def test_custom_script_program_from_text_and_file_runs(cell: Cell, tmp_path: Path) -> None:
    text = """def users():
  write_output_integer_register(0, 1)
  movej([0.05, -1.9, 1.9, -1.57, -1.57, 0], a=10, v=1.5)
  write_output_integer_register(0, 2)
end
"""
    assert cell.control.sendCustomScript(text)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(NEAR, abs=1e-9))
    at_home(cell)
    path = tmp_path / "users.script"
    path.write_text(text)
    assert cell.control.sendCustomScriptFile(str(path))
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(NEAR, abs=1e-9))


def test_custom_script_of_a_sender_that_has_hung_up_is_read() -> None:
    """On a busy machine the controller may find the connection, the program and the hang-up all at once."""
    with start() as process, process.control() as control:
        for number in range(5):
            process.process.send_signal(signal.SIGSTOP)
            send_script(process.address, f"def users():\n  x = missing{number}()\nend\n")
            time.sleep(0.2)  # longer than between two packets of the port, which find nobody
            process.process.send_signal(signal.SIGCONT)
            wait_until(lambda name=f"missing{number}": name in "\n".join(control.log()))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("x = [1, 2][2]", "users, line 4: index 2 is outside a list of 2"),
        ("x = 1 / 0", "users, line 4: division by zero"),
        ("get_joint_torques()", "get_joint_torques is not simulated"),
        ("x = missing + 1", "'missing' has no value yet"),
        ("movej([0, 0, 0, 0, 0, 7])", "joint 5 (wrist 3) at 401.1° is outside the joint limits"),
        ("x = get_inverse_kin(p[3, 0, 0, 0, 0, 0])", "get_inverse_kin: no solution"),
    ],
)
def test_custom_script_runtime_error_reports_line(cell: Cell, line: str, message: str) -> None:
    # By the script port alone: the library waits without end for a script that dies.
    send_script(cell.address, f"def users():\n  sync()\n  sync()\n  {line}\n  movej([1,0,0,0,0,0])\nend\n")
    wait_until(lambda: message in log(cell))
    assert cell.receive.getActualQ() == pytest.approx(HOME, abs=1e-9)
    assert cell.dashboard.programState().startswith("STOPPED")


@pytest.mark.parametrize("line", ["x = = 1", "while = 3", "x = no_such_function(1)", "end end"])
def test_custom_script_invalid_does_not_start(cell: Cell, line: str) -> None:
    before = log(cell).count("program refused")
    send_script(cell.address, f"def users():\n  {line}\nend\nend\n")
    wait_until(lambda: log(cell).count("program refused") > before)
    assert cell.dashboard.programState() == "PLAYING rtde_control"
    assert cell.control.moveJ(NEAR, 3.0, 20.0)
