"""A cell in use for a day of simulated time: sessions, stops, pauses, faults and restarts at random, one after another.

Simulated time is wall time times the arm's speed-up: no turn waits for the next, and what is computed takes its real
time. After each turn the arm rests and the service's memory and descriptors are measured; their growth over a service's
life, once warm, is bounded. The second half of the day is one life, without a restart, for a leak shows in a long one
only. The disk holds what the journal names and nothing else; events, journal and motion are checked as after a fault
schedule.
"""

import os
import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.session_state import State
from acquisition.store import Journal
from api import ProblemError
from tests.chaos.fault_schedule import FAULTS, Scene, check, explained, until_it_waits
from tests.chaos.scene import scene
from tests.crash.crashing import assert_rests
from tests.load.loaded_cell import acknowledge_what_is_latched

SPEED = 60.0
CHECK_EVERY = 10  # turns
WARMING_UP = 15
"""Turns of a service in which caches fill and threads are begun."""
GROWTH_BYTES, GROWTH_DESCRIPTORS = 24 << 20, 8
"""What a warm service may have gained by its end, of a fitted line."""

TURNS = {"nothing": 10, "stop": 3, "halt": 2, "pause": 3, "fault": 4, "kill": 1, "end": 1}
"""What happens in a session, and how often of 24."""

RESTARTS = frozenset({"kill", "end"})

SOAKED = sorted(set(FAULTS) - {"service killed", "service ended", "object nudged"})


@dataclass
class Life:
    """What was measured of one service."""

    pid: int
    rows: list[tuple[int, int]]  # bytes, descriptors

    def measure(self) -> dict[str, Any]:
        """Takes its resident memory and open descriptors; returns them as part of the turn's line."""
        status = Path(f"/proc/{self.pid}/status").read_text(encoding="utf-8")
        resident = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:"))
        self.rows.append((resident * 1024, len(os.listdir(f"/proc/{self.pid}/fd"))))
        size, descriptors = self.rows[-1]
        return {"life": len(self.rows), "memory_MB": round(size / 1e6, 1), "descriptors": descriptors}

    def growth(self) -> tuple[float, float]:
        """Bytes and descriptors gained once warm, by fitted lines; 0 of too short a life."""
        rows = np.array(self.rows[WARMING_UP:], dtype=float)
        if len(rows) < WARMING_UP:
            return 0.0, 0.0
        slopes = np.polyfit(np.arange(len(rows)), rows, 1)[0]
        return float(slopes[0] * len(rows)), float(slopes[1] * len(rows))


def run(folder: Path, address: str, hours: float, seed: int, note: Callable[[dict[str, Any]], None]) -> bool:
    """Runs the day; calls `note` with each turn and with the summary. Whether everything held."""
    chance = random.Random(seed)  # noqa: S311 - a test's seed
    counts = dict.fromkeys(TURNS, 0)
    lives: list[Life] = []
    with scene(folder, address, SPEED, disk_mb=4096) as made:
        begun, number = time.monotonic(), 0
        while (simulated_h := (time.monotonic() - begun) * SPEED / 3600) < hours:
            made.bench.serve()
            assert made.bench.service is not None
            if not lives or lives[-1].pid != made.bench.service.process.pid:
                lives.append(Life(made.bench.service.process.pid, []))
            kinds = [kind for kind in TURNS if kind not in RESTARTS or simulated_h < hours / 2]
            (kind,) = chance.choices(kinds, [TURNS[kind] for kind in kinds])
            counts[kind] += 1
            line = turn(made, kind, chance)
            if kind not in RESTARTS:
                assert made.bench.service.process.pid == lives[-1].pid, "the service has ended by itself"
                line |= lives[-1].measure()
            note({"turn": number, "hour": round(simulated_h, 2), "load": os.getloadavg()[0], **line})
            number += 1
            if number % CHECK_EVERY == 0:
                made.bench.serve()
                check(made)
                check_disk(made.bench.data)
        made.bench.serve()
        check(made)
        check_disk(made.bench.data)
        growths = [life.growth() for life in lives]
        note(
            {
                "hours": round(simulated_h, 1),
                "turns": counts,
                "lives": [len(life.rows) for life in lives],
                "growth_MB": [round(size / 1e6, 1) for size, _ in growths],
                "growth_descriptors": [round(count, 1) for _, count in growths],
                "data_MB": round(sum(p.stat().st_size for p in made.bench.data.rglob("*") if p.is_file()) / 1e6),
            }
        )
    return all(size <= GROWTH_BYTES and count <= GROWTH_DESCRIPTORS for size, count in growths)


def turn(made: Scene, kind: str, chance: random.Random) -> dict[str, Any]:
    """One session in which something happens, put right and ended; what it was."""
    bench = made.bench
    assert bench.undisturbed is not None
    client = bench.serve()
    made.motion.begin()
    bench.make_ready(client)
    session_id = bench.start_from_home(client)
    line: dict[str, Any] = {"kind": kind}
    time.sleep(chance.uniform(0.0, bench.undisturbed.seconds))
    with suppress(ProblemError):  # the session may have ended
        match kind:
            case "stop":
                client.stop(session_id)
            case "halt":
                client.halt()
            case "pause":
                client.pause(session_id)
                until_it_waits(bench, session_id)
                client.resume(session_id)
            case "fault":
                line["fault"] = chance.choice(SOAKED)
                if line["fault"] != "clock stepped by an hour" or made.clock is not None:
                    FAULTS[line["fault"]](made, chance)
            case "kill" | "end":
                FAULTS["service killed" if kind == "kill" else "service ended"](made, chance)
            case _:
                pass
    waits = until_it_waits(bench, session_id)
    while made.to_mend:
        made.to_mend.pop()()
    bench.control.fault("clear")
    client = bench.serve()
    session = waits or until_it_waits(bench, session_id)
    assert session is not None, "the session neither ends nor waits once everything is right again"
    made.motion.end()
    assert_rests(bench)
    line |= {"state": State.STOPPED} if session.state is State.STOPPED else explained(session)
    if session.state in (State.INTERRUPTED, State.PAUSED):
        acknowledge_what_is_latched_by(client)
        client.stop(session_id)
    acknowledge_what_is_latched(client)
    return line


def acknowledge_what_is_latched_by(client: Any) -> None:
    """Acknowledges where that is possible while a session holds the rig."""
    with suppress(ProblemError):
        client.acknowledge()


def check_disk(data: Path) -> None:
    """Every session's folder is the journal's, and every one of the journal's is there."""
    journal = Journal(data / "rig.db")
    try:
        known = {row.id for row in journal.sessions(100_000)}
    finally:
        journal.close()
    assert {folder.name for folder in (data / "sessions").iterdir()} == known
