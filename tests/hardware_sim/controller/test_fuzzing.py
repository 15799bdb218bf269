"""Properties of the protocols under generated input, without a process in between."""

import contextlib
import re
import socket
import struct
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hardware_sim.controller.compiler import compile_program
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.functions import VOCABULARY
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.registers import INPUT_TYPES, OUTPUT_TYPES
from hardware_sim.controller.rtde import RtdeConnection, broadcast
from hardware_sim.controller.syntax import ScriptSyntaxError
from tests.hardware_sim.controller.cells import HOME
from tests.hardware_sim.controller.traffic import frames

QUICK = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
LONG = settings(QUICK, max_examples=5_000)

inputs = st.lists(st.sampled_from(sorted(INPUT_TYPES)) | st.text("abz_,0é", max_size=8), max_size=6)
outputs = st.lists(st.sampled_from(sorted(OUTPUT_TYPES)) | st.text("abz_,0é", max_size=8), max_size=6)
frequencies = st.sampled_from([500.0, 125.0, 10.0, 1e9]) | st.floats(allow_nan=True)


def framed(kind: str, payload: bytes) -> bytes:
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload


def listed(names: list[str]) -> bytes:
    return ",".join(names).encode("utf-8", "replace")


requests = st.one_of(
    st.just(framed("V", b"\x00\x02")),
    st.sampled_from(["V", "v", "S", "P"]).map(lambda kind: framed(kind, b"")),
    st.builds(lambda hz, names: framed("O", struct.pack(">d", hz) + listed(names)), frequencies, outputs),
    inputs.map(lambda names: framed("I", listed(names))),
    st.binary(max_size=60).map(lambda data: framed("U", data)),
    st.builds(lambda n, data: framed("U", bytes([n]) + data), st.integers(1, 3), st.binary(max_size=60)),
    st.binary(max_size=20).map(lambda data: framed("M", data)),
    st.builds(framed, st.integers(0, 255).map(chr), st.binary(max_size=20)),
)
ANSWERED = "VvOISP"


CONTROLLER = Controller(MODELS["ur5e"], HOME, now=0.0)


@contextlib.contextmanager
def connected() -> Iterator[tuple[RtdeConnection, socket.socket]]:
    """An RTDE connection of a controller without ports, and its client's end."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    theirs.setblocking(False)
    with ours, theirs:
        yield RtdeConnection(ours, CONTROLLER, {}), theirs


def talk(requests: list[bytes], chunks: list[int]) -> list[bytes]:
    """Replies to requests that arrive in chunks of these sizes."""
    with connected() as (connection, client):
        data, replies = b"".join(requests), b""
        at, turn = 0, 0
        while at < len(data) and not connection.closed:
            size = chunks[turn % len(chunks)]
            connection.received(data[at : at + size])
            connection.flush()
            at, turn = at + size, turn + 1
            try:
                replies += client.recv(1 << 20)
            except BlockingIOError:
                continue
        return list(frames(replies))


def answers_once(requests: list[bytes], chunks: list[int]) -> None:
    """Every request is answered once, in order, and nothing else is; however the bytes are cut."""
    replies = talk(requests, chunks)
    assert [chr(reply[2]) for reply in replies] == [chr(r[2]) for r in requests if chr(r[2]) in ANSWERED]
    assert replies == talk(requests, [1 << 20])


def packets_fit_their_recipe(names: list[str], frequency: float) -> None:
    """What is accepted is sent, in the size that the types say."""
    with connected() as (connection, client):
        connection.received(framed("V", b"\x00\x02") + framed("O", struct.pack(">d", frequency) + listed(names)))
        connection.received(framed("S", b""))
        connection.flush()
        for tick in range(600):
            CONTROLLER.tick(tick * 0.002)
            broadcast([connection], CONTROLLER)
        replies = list(frames(client.recv(1 << 24)))
        types = replies[1][4:].decode().split(",")
        widths = {"UINT64": 8, "DOUBLE": 8, "UINT8": 1, "BOOL": 1, "VECTOR3D": 24, "VECTOR6D": 48}
        sizes = {len(reply) for reply in replies[3:]}
        if replies[1][3]:
            assert sizes <= {4 + sum(24 if t.startswith("VECTOR6I") else widths.get(t, 4) for t in types)}
            assert sizes or frequency < 1.0
        else:
            assert not sizes


WORDS = re.split(
    r"\s+",
    """( ) [ ] , + - * / % < > = . : # ' " == != p[ 0 1 1e999 0x7fffffff x y True end else: if elif while return global
    local run kill join halt break and or not xor enter_critical sync() def thread g(a): t():""",
)
words = st.sampled_from([*WORDS, " ", "\n", "\t"])
programs = st.lists(words, max_size=40).map(lambda drawn: "def f():\n" + " ".join(drawn) + "\nend\n")


def compiles_or_says_why(text: str) -> None:
    with contextlib.suppress(ScriptSyntaxError):
        compile_program(text, VOCABULARY)


values = st.one_of(
    st.integers(-(2**31), 2**31).map(str),
    st.floats().map(repr).filter(lambda text: text not in ("nan", "inf", "-inf")),
    st.sampled_from(["True", "[]", "[0]", "p[0,0,0,0,0,0]", "p[0.3,-0.3,0.3,0,3.1,0]", "[0,-1.9,1.9,-1.57,-1.57,0]"]),
    st.sampled_from(['"text"', "1e308 * 10", "x", "[1e308, 1e308, 1e308, 1e308, 1e308, 1e308]"]),
)
calls = st.builds(
    lambda name, given: f"{name}({', '.join(given)})",
    st.sampled_from(sorted(VOCABULARY.immediate | VOCABULARY.waiting)),
    st.lists(values, max_size=8),
)
statements = st.one_of(
    calls,
    calls.map(lambda call: f"x = {call}"),
    st.builds(
        lambda a, sign, b: f"x = {a} {sign} {b}", values, st.sampled_from(["+", "-", "*", "/", "%", "<"]), values
    ),
    st.builds(lambda index, value: f"x[{index}] = {value}", values, values),
)


def runs_or_ends(lines: list[str]) -> None:
    """Whatever a program calls with whatever values: at worst it ends with an exception that is reported."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load("def f():\n  x = [0, 0, 0, 0, 0, 0]\n" + "".join(f"  {line}\n" for line in lines) + "end\n")
    for tick in range(60):
        controller.tick(tick * 0.002)
    assert all(abs(q) < 7.0 for q in controller.arm.joints)
    for value in controller.registers.values:
        assert value == value  # noqa: PLR0124 - NaN is not


sizes = st.lists(st.integers(1, 40), min_size=1)


@QUICK
@given(st.lists(requests, max_size=12), sizes)
def test_dashboard_and_control_requests_get_one_reply_each(sent: list[bytes], chunks: list[int]) -> None:
    answers_once(sent, chunks)


@settings(QUICK, max_examples=25)
@given(outputs, frequencies)
def test_rtde_packets_fit_their_recipe(names: list[str], frequency: float) -> None:
    packets_fit_their_recipe(names, frequency)


@QUICK
@given(programs)
def test_compile_arbitrary_text_succeeds_or_raises_syntax_error(text: str) -> None:
    compiles_or_says_why(text)


@settings(QUICK, max_examples=40)
@given(st.lists(statements, min_size=1, max_size=6))
def test_script_arbitrary_call_runs_or_raises_script_error(lines: list[str]) -> None:
    runs_or_ends(lines)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("strategy", "check"),
    [
        (st.tuples(st.lists(requests, max_size=12), sizes), lambda case: answers_once(*case)),
        (programs, compiles_or_says_why),
        (st.lists(statements, min_size=1, max_size=6), runs_or_ends),
    ],
)
def test_fuzzing_thousands_of_cases_pass(strategy: st.SearchStrategy[Any], check: Callable[[Any], None]) -> None:
    LONG(given(strategy)(check))()
