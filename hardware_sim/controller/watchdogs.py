"""Watchdogs of `rtde_set_watchdog` (UR script manual): a variable must arrive at a minimum frequency."""

from dataclasses import dataclass


@dataclass
class _Watchdog:
    period: float  # s
    action: str
    last: float


class Watchdogs:
    """The watchdogs of one program; times are time.monotonic()."""

    def __init__(self) -> None:
        self._by_variable: dict[str, _Watchdog] = {}

    def set(self, variable: str, frequency: float, action: str, now: float) -> None:
        """Arms a watchdog; frequency in Hz, action `stop`, `pause` or `ignore`."""
        self._by_variable[variable] = _Watchdog(1.0 / frequency, action, now)

    def clear(self) -> None:
        self._by_variable.clear()

    def feed(self, names: frozenset[str], now: float) -> None:
        """Resets the watchdogs of the names in a packet."""
        for variable, watchdog in self._by_variable.items():
            if variable in names:
                watchdog.last = now

    def postpone(self, seconds: float) -> None:
        """Lets all expire later by `seconds`, for which this process has had no core."""
        for watchdog in self._by_variable.values():
            watchdog.last += seconds

    def expired(self, now: float) -> tuple[str, str] | None:
        """The action of a watchdog whose variable is late, and the reason; once for each period."""
        for variable, watchdog in self._by_variable.items():
            if now - watchdog.last > watchdog.period:
                watchdog.last = now
                return watchdog.action, f"watchdog: {variable} did not arrive for {watchdog.period:.3f} s"
        return None
