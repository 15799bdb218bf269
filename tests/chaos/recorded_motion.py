"""Whether the arm moved unasked, by the simulated controller's own record of every tick."""

from pathlib import Path

import numpy as np

from hardware_sim.controller.trace import MAGIC
from tests.load.loaded_cell import ROW

BRAKES_WITHIN_S = 1.0
"""From the last moment at which motion was allowed to rest, s: the lease's or watchdog's 0.25, the deceleration's 0.2,
and the time that a busy machine takes to look."""
MOVED_RAD = 1e-6
"""Change of a joint from one row to the next that counts as motion, rad."""


class AllowedMotion:
    """Intervals of the record in which a person had asked for motion; outside them the arm rests.

    They are counted in rows, not in the controller's time, which begins anew when the controller does.
    """

    def __init__(self, record: Path) -> None:
        self._record = record
        self._intervals: list[tuple[int, int]] = []  # first row, row at which motion was last allowed
        self._since: int | None = None
        self._checked = 0  # rows

    def begin(self) -> None:
        """Somebody is about to ask for motion."""
        if self._since is None:
            self._since = self._rows()

    def end(self) -> None:
        """Nobody wants motion any more; harmless when nobody did."""
        if self._since is not None:
            self._intervals.append((self._since, self._rows()))
            self._since = None

    def unasked(self) -> list[float]:
        """The controller's times, s, at which the arm moved since the last call although nobody had asked."""
        first, count = self._checked, self._rows() - self._checked
        with self._record.open("rb") as file:
            file.seek(len(MAGIC) + first * ROW.itemsize)
            rows = np.frombuffer(file.read(count * ROW.itemsize), dtype=ROW)
        self._checked += max(count - 1, 0)  # the last row is compared with the next one
        moved = np.zeros(count, dtype=bool)
        moved[1:] = np.abs(np.diff(rows["joints"], axis=0)).max(axis=1) > MOVED_RAD
        elapsed_s = np.concatenate(([0.0], np.cumsum(np.maximum(np.diff(rows["time"]), 0.0))))[:count]
        for begun, ended in self._intervals:
            start, stop = (min(max(row - first, 0), count) for row in (begun, ended))
            if stop < count:
                stop = int(np.searchsorted(elapsed_s, elapsed_s[stop] + BRAKES_WITHIN_S, side="right"))
            moved[start:stop] = False
        if self._since is not None:
            moved[max(self._since - first, 0) :] = False
        self._intervals = [interval for interval in self._intervals if interval[1] >= self._checked - 100_000]
        return [float(time) for time in rows["time"][moved]]

    def _rows(self) -> int:
        return (self._record.stat().st_size - len(MAGIC)) // ROW.itemsize
