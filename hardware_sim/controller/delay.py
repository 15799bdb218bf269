"""Latency and jitter of a link: bytes are held back, in order, each piece for a random time."""

import random
import time
from collections import deque


class Delay:
    """Random latencies: `latency` plus up to `jitter`, in s; the same seed draws the same times."""

    def __init__(self, latency: float, jitter: float, seed: int) -> None:
        self._latency, self._jitter = latency, jitter
        self._random = random.Random(seed)  # noqa: S311 - a simulation, no secret

    def draw(self) -> float:
        """The next piece's latency, s."""
        return self._latency + self._jitter * self._random.random()


class Pipe:
    """One direction of one connection."""

    def __init__(self) -> None:
        self.delay: Delay | None = None
        self.held = 0  # bytes
        self._pieces: deque[tuple[float, bytes]] = deque()

    def holds_back(self, data: bytes) -> bool:
        """Holds back bytes that must not arrive yet; returns False if nothing delays them."""
        if self.delay is None and not self._pieces:
            return False
        due = time.monotonic() + (0.0 if self.delay is None else self.delay.draw())
        # TCP keeps the order: no piece overtakes an earlier one.
        self.held += len(data)
        self._pieces.append((max(due, self._pieces[-1][0]) if self._pieces else due, data))
        return True

    def arrived(self, now: float) -> list[bytes]:
        """The pieces whose latency is over."""
        pieces: list[bytes] = []
        while self._pieces and self._pieces[0][0] <= now:
            pieces.append(self._pieces.popleft()[1])
            self.held -= len(pieces[-1])
        return pieces

    def put_back(self, data: bytes) -> None:
        """Keeps the rest of arrived bytes if the other end does not accept it yet."""
        if data:
            self.held += len(data)
            self._pieces.appendleft((0.0, data))
