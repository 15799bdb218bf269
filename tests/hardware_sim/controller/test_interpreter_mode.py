"""Interpreter mode at port 30020: replies, order, variables and functions of statements, skipping and aborting."""

import re
import socket
from collections.abc import Iterator

import pytest

from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, send_script, start, wait_until

HOST = """def host():
  global shared = 5
  interpreter_mode()
  textmsg("over")
end
"""
REPLY = re.compile(r"(\w+):\W+(\d+)?")  # as UR's own example reads replies


class Interpreter:
    """One client of the port."""

    def __init__(self, address: str) -> None:
        self.socket = socket.create_connection((address, 30020), 60.0)
        self._lines = self.socket.makefile("r", encoding="utf-8")

    def ask(self, text: str) -> tuple[str, int]:
        """Sends a line; the kind and the number of its reply."""
        self.socket.sendall((text + "\n").encode())
        found = REPLY.match(self._lines.readline())
        assert found is not None
        return found[1], int(found[2] or -1)

    def executed(self, number: int) -> bool:
        """Whether all statements up to one have begun."""
        return self.ask("statelastexecuted") == ("state", number)


@pytest.fixture(scope="module")
def process() -> Iterator[ControllerProcess]:
    with start(speed=10.0) as process:
        yield process


@pytest.fixture
def control(process: ControllerProcess) -> Iterator[ControlClient]:
    with process.control() as control:
        send_script(process.address, 'def host():\n  global shared = 5\n  interpreter_mode()\n  textmsg("over")\nend\n')
        wait_until(lambda: control.state()["program_running"])
        yield control
        control.fault("program_stop")


@pytest.fixture
def interpreter(process: ControllerProcess, control: ControlClient) -> Iterator[Interpreter]:
    client = Interpreter(process.address)
    yield client
    client.socket.close()


def said(control: ControlClient, text: str) -> bool:
    return any(line.endswith("textmsg " + text) for line in control.log())


def test_interpreter_without_program_discards(process: ControllerProcess) -> None:
    client = Interpreter(process.address)
    assert client.ask("textmsg(1)")[0] == "discard"
    client.socket.close()


def test_statements_share_variables_and_functions(control: ControlClient, interpreter: Interpreter) -> None:
    kind, first = interpreter.ask("x = 3")
    assert kind == "ack"
    assert interpreter.ask('def f(a): x = x + a textmsg("sum ", x + shared) end') == ("ack", first + 1)
    assert interpreter.ask("f(10)") == ("ack", first + 2)
    assert interpreter.ask('textmsg("x ", x)') == ("ack", first + 3)
    wait_until(lambda: said(control, "sum 18"))
    wait_until(lambda: said(control, "x 13"))
    assert interpreter.ask("statelastinterpreted") == ("state", first + 3)
    wait_until(lambda: interpreter.executed(first + 3))
    assert interpreter.ask("stateunexecuted") == ("state", 0)


def test_statement_with_error_is_discarded_and_program_goes_on(
    control: ControlClient, interpreter: Interpreter
) -> None:
    for wrong in ("movej([0,", "no_such_function()", "end"):
        assert interpreter.ask(wrong)[0] == "discard"
    assert interpreter.ask('textmsg("still here")')[0] == "ack"
    wait_until(lambda: said(control, "still here"))
    assert control.state()["program_running"]


def test_end_interpreter_lets_program_go_on(control: ControlClient, interpreter: Interpreter) -> None:
    assert interpreter.ask("y = 1")[0] == "ack"
    kind, number = interpreter.ask("end_interpreter()")
    assert kind == "ack"
    wait_until(lambda: said(control, "over"))
    assert interpreter.ask("statelastcleared") == ("state", number)


def test_clear_interpreter_forgets_functions(control: ControlClient, interpreter: Interpreter) -> None:
    assert interpreter.ask('def g(): textmsg("g") end')[0] == "ack"
    kind, number = interpreter.ask("clear_interpreter()")
    assert kind == "ack"
    wait_until(lambda: interpreter.executed(number))
    assert interpreter.ask("g()")[0] == "discard"


def test_skipbuffer_and_abort_end_moves(control: ControlClient, interpreter: Interpreter) -> None:
    there = [1.5, *HOME[1:]]
    _, number = interpreter.ask(f"movej({there}, a=1, v=0.2)")
    interpreter.ask(f"movej({HOME}, a=1, v=0.2)")
    assert interpreter.ask('textmsg("skipped")')[0] == "ack"
    wait_until(lambda: interpreter.executed(number))
    assert interpreter.ask("stateunexecuted") == ("state", 2)
    assert interpreter.ask("skipbuffer")[0] == "ack"
    wait_until(lambda: any(control.state()["joint_speeds"]))
    assert interpreter.ask("abort")[0] == "ack"
    wait_until(lambda: not any(control.state()["joint_speeds"]))
    assert control.state()["joints"][0] < 1.4
    assert interpreter.ask('textmsg("after")')[0] == "ack"
    wait_until(lambda: said(control, "after"))
    assert not said(control, "skipped")
