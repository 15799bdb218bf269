"""Every joint sample of a session on disk, so that an independent audit can replay what the arm did.

Format: the magic `LPJOINTS`, then rows of seven little-endian float64: time stamp (s, the controller's), six true
joints (rad). At least one row per 8 ms of motion time while the arm moves, none while it stands.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

MAGIC = b"LPJOINTS"
PERIOD = 0.008  # s of motion time
_ROW = struct.Struct("<7d")


class TraceWriter:
    """Appends samples to a file."""

    def __init__(self, path: Path, motion_step: float) -> None:
        """`motion_step` is the motion time between two calls of `sample`, in s. Raises OSError."""
        self._every = max(1, int(PERIOD / motion_step + 1e-9))
        # Unbuffered: 125 small writes a second are cheap, and a killed process loses nothing.
        self._file = path.open("ab", buffering=0)
        if self._file.tell() == 0:
            self._file.write(MAGIC)
        self._last: list[float] = []
        self._written: list[float] = []
        self._skipped = 0

    def sample(self, timestamp: float, joints: Sequence[float]) -> None:
        """Takes one sample; writes every n-th of a motion, its first and its last."""
        moved = joints != self._last
        self._skipped += 1
        if (moved and (self._skipped >= self._every or not self._written)) or (not moved and joints != self._written):
            self._write(timestamp, joints)
        self._last = list(joints)

    def _write(self, timestamp: float, joints: Sequence[float]) -> None:
        self._file.write(_ROW.pack(timestamp, *joints))
        self._written = list(joints)
        self._skipped = 0

    def close(self, timestamp: float) -> None:
        """Writes the last sample and closes."""
        if self._last and self._last != self._written:
            self._write(timestamp, self._last)
        self._file.close()


def read_trace(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Time stamps (N,) in s and joints (N, 6) in rad; a row cut off by a kill is left out. Raises ValueError."""
    data = path.read_bytes()
    if data[: len(MAGIC)] != MAGIC:
        raise ValueError(f"{path} is not a trace of joints")
    count = (len(data) - len(MAGIC)) // _ROW.size
    rows = np.frombuffer(data, "<f8", count * 7, len(MAGIC)).reshape(-1, 7)
    return rows[:, 0].copy(), rows[:, 1:].copy()
