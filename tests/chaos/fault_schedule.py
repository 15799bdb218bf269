"""Combinations of faults at random moments of a session, drawn by seed; what a person does about them; what must hold.

A case draws one to three of FAULTS and their moments, starts a session, lets them happen, waits until the session has
ended or waits for a person, puts everything right, resumes, and checks:

- The session's state is one of END_STATES, with a reason that says in words what happened and what to do.
- Resumed, it completes, with each image once and those that were announced unchanged, and with the normals of an
  undisturbed session.
- A listener that reconnects has heard every event once and in order; the journal passes SQLite's own check.
- The arm moved only between a person's request and the session's end, and touched nothing (the controller's record).
"""

import os
import random
import signal
import sqlite3
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from acquisition.models.errors import ErrorCode
from acquisition.models.problem_table import PROBLEMS
from acquisition.runner.loop import INTERRUPTING_CODES, PAUSING_CODES
from acquisition.session_state import State
from acquisition.store import Journal
from api import Client, ProblemError
from api.rest.schemas import SessionResource
from tests.chaos.event_follower import EventFollower
from tests.chaos.recorded_motion import AllowedMotion
from tests.crash.crashing import (
    Bench,
    announced,
    assert_equal_to_the_undisturbed,
    assert_rests,
    fill,
    resume,
)

WAITS_WITHIN_S = 240.0
STUCK_S = 12.0
"""A session that goes no further for so long waits for a person: a disk without a byte left cannot even say so."""

END_STATES: dict[State, frozenset[ErrorCode]] = {
    State.COMPLETED: frozenset(),
    State.INTERRUPTED: INTERRUPTING_CODES | {ErrorCode.SERVICE_RESTARTED},
    State.PAUSED: PAUSING_CODES,
}
"""States in which faults may leave a session, and the reasons that go with each. None of them fails a session."""


@dataclass
class Scene:
    """A bench under faults, and what has to be put right again."""

    bench: Bench
    motion: AllowedMotion
    events: EventFollower
    clock: Path | None = None
    """File that holds the services' shift against the real time; None where the clock cannot be stepped."""
    shift_s: int = 0
    to_mend: list[Callable[[], None]] = field(default_factory=list)

    def step_clock(self, seconds: int) -> None:
        """Steps the services' wall clock, as a time server or a person does."""
        assert self.clock is not None
        self.shift_s += seconds
        with self.clock.open("r+b") as file:
            file.write(struct.pack("q", self.shift_s))

    def child(self, of: str) -> int | None:
        """Process id of the running service's child whose command line holds this."""
        service = self.bench.service
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, StopIteration):
                status = (folder / "status").read_text(encoding="utf-8")
                parent = int(next(line for line in status.splitlines() if line.startswith("PPid:")).split()[1])
                command = (folder / "cmdline").read_bytes().decode(errors="replace")
                if service is not None and parent == service.process.pid and of in command:
                    return int(folder.name)
        return None


def _controller(kind: str, **parameters: Any) -> Callable[[Scene, random.Random], None]:
    def happen(scene: Scene, _: random.Random) -> None:
        scene.bench.control.fault(kind, **parameters)

    return happen


def _delayed(scene: Scene, _: random.Random) -> None:
    scene.bench.control.fault("delay", port=30004, latency_ms=40, jitter_ms=20)
    scene.to_mend.append(lambda: scene.bench.control.fault("delay", port=30004, latency_ms=0, jitter_ms=0))


def _local_mode(scene: Scene, _: random.Random) -> None:
    scene.bench.control.fault("local_mode")
    scene.to_mend.append(lambda: scene.bench.control.fault("remote_mode"))


def _nudged(scene: Scene, chance: random.Random) -> None:
    shift = [chance.choice([-0.006, 0.006]), 0.0, 0.0]
    scene.bench.control.fault("nudged_object", shift_m=shift)
    scene.to_mend.append(lambda: scene.bench.control.fault("nudged_object", shift_m=[-value for value in shift]))


def _service_killed(scene: Scene, _: random.Random) -> None:
    if scene.bench.service is not None:
        scene.bench.kill()
        scene.motion.end()


def _service_ended(scene: Scene, _: random.Random) -> None:
    service, scene.bench.service = scene.bench.service, None
    if service is not None:
        service.process.terminate()
        scene.motion.end()
        service.process.wait(60)


def _kill(of: str) -> Callable[[Scene, random.Random], None]:
    def happen(scene: Scene, _: random.Random) -> None:
        process = scene.child(of)
        if process is not None:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    return happen


def _frozen_service(scene: Scene, chance: random.Random) -> None:
    service = scene.bench.service
    if service is not None:
        service.process.send_signal(signal.SIGSTOP)
        time.sleep(chance.uniform(0.1, 2.0))
        service.process.send_signal(signal.SIGCONT)


def _camera_gone(scene: Scene, _: random.Random) -> None:
    world = scene.bench.cell.world_pid
    os.kill(world, signal.SIGSTOP)
    scene.to_mend.append(lambda: os.kill(world, signal.SIGCONT))


def _disk_full(scene: Scene, chance: random.Random) -> None:
    filler = fill(scene.bench.data, chance.choice([0, 16 << 20]))
    scene.to_mend.append(lambda: filler.unlink(missing_ok=True))


def _clock_stepped(scene: Scene, chance: random.Random) -> None:
    scene.step_clock(chance.choice([-3600, 3600]))


FAULTS: dict[str, Callable[[Scene, random.Random], None]] = {
    "protective stop": _controller("protective_stop"),
    "safeguard stop": _controller("safeguard_stop"),
    "emergency stop": _controller("emergency_stop"),
    "power off": _controller("power_off"),
    "program stopped at the pendant": _controller("program_stop"),
    "program paused at the pendant": _controller("program_pause"),
    "local mode": _local_mode,
    "link cut": _controller("cut", port=30004),
    "dashboard cut": _controller("cut", port=29999),
    "link stalled": _controller("stall", port=30004, seconds=3.0),
    "half a packet": _controller("half_packet"),
    "link delayed": _delayed,
    "controller restarted": _controller("restart"),
    "lamp dead": _controller("lamp", fraction=0.0),
    "frames dropped": _controller("dropped_frame", count=3),
    "object nudged": _nudged,
    "camera gone": _camera_gone,
    "service killed": _service_killed,
    "service ended": _service_ended,
    "service frozen": _frozen_service,
    "driver killed": _kill("acquisition.devices.ur.driver"),
    "compute process killed": _kill("spawn_main"),
    "disk full": _disk_full,
    "clock stepped by an hour": _clock_stepped,
}


def run(scene: Scene, seed: int) -> dict[str, Any]:
    """One case; what happened, as a line of the results. Raises AssertionError where something does not hold."""
    chance, bench = random.Random(seed), scene.bench  # noqa: S311 - a test's seed
    drawn = chance.sample(sorted(FAULTS), chance.choice([1, 2, 2, 3]))
    names = [name for name in drawn if name != "clock stepped by an hour" or scene.clock is not None]
    assert bench.undisturbed is not None
    moments = sorted(chance.uniform(0.0, 1.2 * bench.undisturbed.seconds) for _ in names)
    client = bench.serve()
    scene.motion.begin()
    bench.make_ready(client)
    scene.motion.end()
    scene.motion.begin()
    session_id = bench.start_from_home(client)
    begun = time.monotonic()
    try:
        for moment, name in zip(moments, names, strict=True):
            time.sleep(max(begun + moment - time.monotonic(), 0.0))
            FAULTS[name](scene, chance)
        waits = until_it_waits(bench, session_id)
        kept = announced(bench.data, session_id)
    finally:
        while scene.to_mend:
            scene.to_mend.pop()()
        bench.control.fault("clear")
    client = bench.serve()
    session = waits or until_it_waits(bench, session_id)
    assert session is not None, "the session neither ends nor waits once everything is right again"
    scene.motion.end()
    line = {"seed": seed, "faults": dict(zip(names, moments, strict=True)), "left_out": len(drawn) - len(names)}
    line |= explained(session)
    assert_rests(bench)
    if session.state in (State.INTERRUPTED, State.PAUSED):
        scene.motion.begin()
        session = resume(bench, client, session_id)
        scene.motion.end()
        assert_rests(bench)
    if session.state is State.COMPLETED:
        assert_equal_to_the_undisturbed(bench, session, kept)
    check(scene)
    return line | {"finally": session.state, "seconds": round(time.monotonic() - begun, 1), "load": os.getloadavg()[0]}


def until_it_waits(bench: Bench, session_id: str) -> SessionResource | None:
    """The session once it has ended or waits for a person; None when it, or its service, goes no further."""
    deadline = time.monotonic() + WAITS_WITHIN_S
    last, since = None, time.monotonic()
    while time.monotonic() < deadline:
        service = bench.service
        if service is None or service.process.poll() is not None:
            return None
        with suppress(httpx.HTTPError, ProblemError), Client(service.url) as client:
            session = client.session(session_id)
            if session.state not in (State.RUNNING, State.PAUSING, State.STOPPING):
                return session
            if (session.state, session.stage, session.progress) != last:
                last, since = (session.state, session.stage, session.progress), time.monotonic()
        if time.monotonic() - since > STUCK_S and "filler" in os.listdir(bench.data):
            return None
        time.sleep(0.1)
    raise AssertionError(f"the session neither ends nor waits: {last}")


def explained(session: SessionResource) -> dict[str, Any]:
    """State and reason of a session that was left to itself; both must be among END_STATES, the reason in words."""
    assert session.state in END_STATES, session
    if session.state is State.COMPLETED:
        return {"state": session.state}
    assert session.reason is not None, session
    code = ErrorCode(session.reason.code)
    assert code in END_STATES[session.state], session
    assert len(session.reason.detail.split()) >= 3, session.reason
    assert PROBLEMS[code].remedy, code
    return {"state": session.state, "code": code, "detail": session.reason.detail, "remedy": PROBLEMS[code].remedy}


def check(scene: Scene) -> None:
    """Events, journal, motion and contacts so far."""
    data = scene.bench.data
    journal = Journal(data / "rig.db")
    try:
        last = journal.last_event_id()
        assert [event.id for event in journal.events(0, last)] == list(range(1, last + 1))
    finally:
        journal.close()
    with sqlite3.connect(data / "rig.db") as opened:
        assert opened.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    opened.close()
    assert scene.events.has_heard(last), f"of {last} events were heard: {scene.events.ids[-20:]}"
    assert not (unasked := scene.motion.unasked()), f"the arm moved unasked at {unasked[:5]}"
    assert not scene.bench.control.collisions()
    assert not list((data / "sessions").rglob(".*")), "half-written files are left"
