"""Simulated faults: documented, reproducible, and their effect on links and arm."""

import itertools
import time

import pytest

from hardware_sim.controller.delay import Delay, Pipe
from hardware_sim.controller.faults import FAULTS
from hardware_sim.controller.modes import SafetyMode
from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, Cell, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

NEAR = [q + 0.1 for q in HOME]


def test_faults_are_all_documented() -> None:
    import hardware_sim.controller.faults as module

    assert module.__doc__ is not None
    for kind in FAULTS:
        assert kind in module.__doc__, kind


def test_delay_same_seed_draws_same_times() -> None:
    first, again, other = (Delay(0.1, 0.05, seed) for seed in (1, 1, 2))
    times = [first.draw() for _ in range(50)]
    assert times == [again.draw() for _ in range(50)]
    assert times != [other.draw() for _ in range(50)]
    assert min(times) >= 0.1
    assert max(times) <= 0.15


def test_pipe_delayed_bytes_keep_order() -> None:
    pipe = Pipe()
    assert not pipe.holds_back(b"a")
    pipe.delay = Delay(60.0, 0.5, 3)
    assert all(pipe.holds_back(bytes([n])) for n in range(20))
    pipe.delay = None
    assert pipe.holds_back(b"late")  # it must not overtake
    assert pipe.arrived(time.monotonic()) == []
    pieces = pipe.arrived(time.monotonic() + 61.0)
    assert b"".join(pieces) == bytes(range(20)) + b"late"
    pipe.put_back(b"rest")
    assert pipe.arrived(time.monotonic()) == [b"rest"]
    assert not pipe.holds_back(b"b")


def test_slow_link_delays_packets_and_loses_none(controller: ControllerProcess) -> None:
    with PlainClient(controller.address) as client, controller.control() as control:
        client.outputs("timestamp")
        client.request("S")
        client.sample()
        control.fault("delay", port=30004, latency_ms=300.0, jitter_ms=40.0, seed=5)
        stamps = [round(client.sample()[0] / 0.002) for _ in range(300)]
        assert control.state()["timestamp"] - 0.002 * stamps[-1] > 0.25
        assert [b - a for a, b in itertools.pairwise(stamps)] == [1] * 299
        control.fault("delay", port=30004)
        wait_until(lambda: control.state()["timestamp"] - [client.sample()[0] for _ in range(30)][-1] < 0.2)


def test_hand_move_stops_running_program_and_moves_resting_arm(cell: Cell) -> None:
    with cell.process.control() as control:
        assert cell.control.moveJ([q + 1.0 for q in HOME], 0.5, 1.0, True)
        wait_until(lambda: cell.receive.getActualQd()[0] > 0.1)
        control.fault("hand_move", joints=NEAR, seconds=0.3)
        wait_until(cell.receive.isProtectiveStopped)
        wait_until(lambda: cell.receive.getActualQ() == pytest.approx(NEAR))
        control.fault("clear")
        control.fault("program_stop")
        control.fault("power_off")
        control.fault("hand_move", joints=HOME, seconds=2.0)  # brakes are opened by hand
        wait_until(lambda: any(cell.receive.getActualQd()))
        wait_until(lambda: cell.receive.getActualQ() == pytest.approx(HOME))
        assert control.state()["safety_mode"] == SafetyMode.NORMAL
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
