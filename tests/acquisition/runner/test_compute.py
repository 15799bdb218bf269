"""The compute process: results, typed errors, death and cancellation, with the real jobs."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.models.route import Route
from acquisition.runner.compute import Compute, Preempted

CELLS = Path(__file__).parents[3] / "hardware_sim" / "cells"
CELL = cell_config.load(CELLS / "cell.sim.toml")
CALIBRATION = cell_config.load_calibration(CELLS / "calibration.sim.json")


@pytest.fixture(scope="module")
def compute():
    process = Compute()
    process.warm()
    yield process
    process.close()


def child(compute: Compute) -> int:
    process = compute._process
    assert process is not None
    assert process.pid is not None
    return process.pid


def test_compute_job_returns_value_or_error_with_context(compute: Compute) -> None:
    route = compute.run(threading.Event(), "plan_route", [], CELL.arm.home, CELL, CALIBRATION)
    assert isinstance(route, Route)
    with pytest.raises(RigError) as error:
        compute.run(threading.Event(), "plan_retreat", (0.0, 1.2, 0.0, 0.0, 0.0, 0.0), CELL, CALIBRATION)
    assert error.value.code is ErrorCode.WAYPOINTS_COLLISION


@pytest.mark.long
def test_compute_urgent_job_preempts_a_preemptible_one(compute: Compute, tmp_path: Path) -> None:
    compute.warm()
    ends: list[BaseException | None] = []

    def wait_for_ever(yields: bool) -> None:
        jobs = (tmp_path / f"{yields}-{number}.json" for number in range(50))  # longer than anybody waits
        try:
            for cache in jobs:
                compute.run(threading.Event(), "make_reach", CELL, CALIBRATION, cache, preemptible=yields)
        except Preempted as error:
            ends.append(error)

    patient = threading.Thread(target=wait_for_ever, args=(True,))
    patient.start()
    while compute._connection is None or not compute._busy.locked():
        time.sleep(0.01)
    route = compute.run(threading.Event(), "plan_route", [], CELL.arm.home, CELL, CALIBRATION)
    patient.join(90)
    assert isinstance(route, Route)
    assert [type(end) for end in ends] == [Preempted]


def test_compute_job_of_killed_process_is_done_once_more(
    compute: Compute, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    compute.warm()
    old, made = child(compute), tmp_path / "reach.json"

    def kill_while_it_works() -> None:
        while not compute._busy.locked():
            time.sleep(0.001)
        os.kill(old, signal.SIGKILL)

    killer = threading.Thread(target=kill_while_it_works)
    killer.start()
    compute.run(threading.Event(), "make_reach", CELL, CALIBRATION, made)
    killer.join()
    assert made.exists()
    assert child(compute) != old
    assert "by SIGKILL" in caplog.text


def test_compute_stop_token_abandons_the_job(compute: Compute, tmp_path: Path) -> None:
    compute.warm()
    stop = threading.Event()
    stop.set()
    with pytest.raises(Halted):
        compute.run(stop, "make_reach", CELL, CALIBRATION, tmp_path / "reach.json")
    assert not (tmp_path / "reach.json").exists()


def test_compute_stop_token_set_before_starts_no_process() -> None:
    idle, stop = Compute(), threading.Event()
    stop.set()
    with pytest.raises(Halted):
        idle.run(stop, "make_reach")
    assert idle._process is None


def test_compute_unknown_job_raises_step_failed(compute: Compute) -> None:
    with pytest.raises(RigError) as error:
        compute.run(threading.Event(), "no_such_job")
    assert error.value.code is ErrorCode.SESSION_STEP_FAILED


@pytest.mark.parametrize("token", ["stop", "while_waiting"])
def test_compute_token_ends_the_wait_for_another_ones_job(token: str) -> None:
    idle, tokens, ends = Compute(), {"stop": threading.Event(), "while_waiting": threading.Event()}, list[str]()

    def wait_its_turn() -> None:
        with pytest.raises(Halted):
            idle.run(tokens["stop"], "make_reach", while_waiting=tokens["while_waiting"])
        ends.append("halted")

    waiting = threading.Thread(target=wait_its_turn, daemon=True)
    with idle._busy:
        waiting.start()
        waiting.join(0.1)
        assert waiting.is_alive()
        tokens[token].set()
        waiting.join(10)
        assert ends == ["halted"]
    assert idle._process is None
