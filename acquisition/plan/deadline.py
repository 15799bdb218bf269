"""Time limit of a search on the monotonic clock."""

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """Time limit on the monotonic clock in s; none: no limit."""

    at_s: float | None = None

    @classmethod
    def within(cls, seconds: float | None) -> "Deadline":
        """Deadline that many seconds from now; none: no limit."""
        return cls(None if seconds is None else time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether the deadline has passed."""
        return self.at_s is not None and time.monotonic() >= self.at_s
