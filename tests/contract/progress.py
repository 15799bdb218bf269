"""Follows a run of schemathesis by the notes of its hooks: says how far it is, and ends one that stands still.

A run takes minutes and says nothing before its end, so a request that is never answered would look like one that takes
long. Each line shows the time, the phase, the answers, and for how long which requests have waited; where no note came
for `STILL_S` the run's stacks are taken and it is killed.
"""

import json
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SAID_EVERY_S = 15.0
STILL_S = 300.0
"""Time without a request or an answer after which a run counts as hanging, s: its longest request may take 180."""


@dataclass
class Notes:
    """What the hooks have noted so far."""

    path: Path
    answers: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    under_way: dict[int, dict[str, Any]] = field(default_factory=dict[int, dict[str, Any]])
    """The request that each thread has sent and that is not answered yet."""
    _read: int = 0

    def read_on(self) -> bool:
        """Reads what has been noted since; whether there was anything."""
        with self.path.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        whole = new[: new.rfind(b"\n") + 1]
        self._read += len(whole)
        for line in whole.splitlines():
            note = json.loads(line)
            if "sent" in note:
                self.under_way[note["thread"]] = note
            else:
                self.under_way.pop(note["thread"], None)
                self.answers.append(note)
        return bool(whole)

    def line(self, elapsed_s: float) -> str:
        """How far the run is."""
        phase = self.answers[-1]["phase"] if self.answers else "starting"
        waiting = ", ".join(
            f"{note['method']} {note['path']} for {time.time() - note['sent']:.0f} s"
            for note in self.under_way.values()
            if time.time() - note["sent"] > 1.0
        )
        return f"  {elapsed_s:4.0f} s {phase}: {len(self.answers)} answers; waits for {waiting or 'nothing'}"


def follow(process: "subprocess.Popen[bytes]", notes: Notes) -> None:
    """Returns when a run has ended; prints how far it is. Raises AssertionError where it stands still, and kills it."""
    begun = said = moved = time.monotonic()
    while process.poll() is None:
        time.sleep(0.2)
        now = time.monotonic()
        if notes.read_on():
            moved = now
        if now - said > SAID_EVERY_S:
            said = now
            print(notes.line(now - begun), flush=True)
        if now - moved > STILL_S:
            process.send_signal(signal.SIGUSR1)
            time.sleep(2.0)
            process.kill()
            process.wait()
            raise AssertionError(f"no request and no answer for {STILL_S:.0f} s:\n{notes.line(now - begun)}")
    notes.read_on()
