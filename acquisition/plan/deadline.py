"""Time limit of a search on the monotonic clock."""

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """A moment on the monotonic clock; none: never."""

    at_s: float | None = None

    @classmethod
    def within(cls, seconds: float | None) -> "Deadline":
        """So many seconds from now."""
        return cls(None if seconds is None else time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether it is past."""
        return self.at_s is not None and time.monotonic() >= self.at_s
