"""Safety monitor: polls the arm, latches faults, and keeps motion forbidden until a person acknowledges.

The latch outlives the fault: the service never decides by itself that a cell is clear. `acknowledge` opens it, and is
refused while the controller still reports the stop. A lost link or driver is latched as well; it may be acknowledged
while it lasts, because the explicit reconnection that follows tests it again. A stop of the whole cell by the software
is latched like the controller's own: whoever pressed it saw a danger, and only a person can say that it has passed.
"""

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from acquisition.devices import Arm, ArmReading
from acquisition.devices.ur import states
from acquisition.models.errors import ErrorCode, RigError

_log = logging.getLogger(__name__)

PERIOD_S = 0.02
"""Polling period, s."""


@dataclass(frozen=True)
class Latch:
    """A fault that nobody has acknowledged yet."""

    code: ErrorCode
    detail: str
    since: float  # seconds since 1970, UTC


def classify(reading: ArmReading) -> states.Fault | None:
    """The fault in a reading that forbids motion until a person has looked; None when there is none.

    An arm that is merely not powered on or not under program control is not a fault; moves refuse it by themselves.
    """
    if not reading.connected:
        why = f": {reading.lost}" if reading.lost else ""
        return states.Fault(ErrorCode.DEVICE_DISCONNECTED, f"The link to the arm, or its driver, is lost{why}.")
    return states.safety_fault(reading.safety_bits)


class SafetyMonitor:
    """Polls `arm.reading` from a thread of its own and keeps the latch.

    `on_change` is called with the new latch, or None, after a fault or an acknowledgement: from the monitor's thread
    when a fault appears, from the thread that calls `acknowledge`. It must be quick; it may call `arm.halt`.
    """

    def __init__(self, arm: Arm, on_change: Callable[[Latch | None], None], latched: Latch | None = None) -> None:
        """`latched` is a latch that outlived the last service."""
        self._arm = arm
        self._on_change = on_change
        self._latch = latched
        self._newest = latched  # the newest stop or fault, latched or come while a latch was closed already
        self._stops = 0  # number of such stops and faults so far
        self._acknowledged_at: dict[str, float] = {}  # actor → time of the acknowledgement (time.monotonic)
        self._was_connected = False  # a link counts as lost only after it was up
        self._latch_lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="safety-monitor", daemon=True)

    def start(self) -> None:
        """Starts polling."""
        self._thread.start()

    def close(self) -> None:
        """Ends polling."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def latch(self) -> Latch | None:
        """The fault that awaits acknowledgement. Any thread may read it; no lock is taken."""
        return self._latch

    def require_clear(self) -> None:
        """Returns if motion is allowed: no fault is present and no latch awaits acknowledgement.

        Raises RigError with the present fault's code, or safety.not_acknowledged.
        """
        fault = self._present_fault()
        if fault is not None:
            raise RigError(fault.code, fault.detail)
        latch = self._latch
        if latch is not None:
            raise RigError(
                ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
                f"Nobody has acknowledged: {latch.detail}",
                fault=str(latch.code),
                since=latch.since,
            )

    @property
    def stops(self) -> int:
        """Number of stops and faults so far, for `acknowledge`; no lock is taken."""
        return self._stops

    def acknowledge(
        self, actor: str, stops: int | None = None, record: Callable[[], None] = lambda: None
    ) -> Latch | None:
        """Opens the latch, because `actor` has looked and finds the cell clear; returns it, None when none was opened.

        `record` is called before, and may take its time. A stop or a fault that has come since the count `stops` of
        `stops` (default: since this call) is not what `actor` has seen: it stays latched. The acknowledgement is
        remembered in any case. Raises RigError safety.still_faulted while the controller reports a stop, and what
        `record` raises.
        """
        stops = self._stops if stops is None else stops
        self.require_over(actor)
        record()
        fault = self.require_over(actor)
        with self._latch_lock:
            opened, self._latch = self._latch, None
            if self._stops != stops:
                opened, self._latch = None, self._newest
            if fault is not None:
                self._was_connected = False
        if opened is not None:
            _log.warning("%s acknowledged: %s", actor, opened.detail)
            self._on_change(None)
        return opened

    def require_over(self, actor: str) -> states.Fault | None:
        """Remembers that `actor` acknowledges; returns the fault of a lost link, the only one that may persist, if any.
        Raises RigError safety.still_faulted while the controller reports a stop."""
        self._acknowledged_at[actor] = time.monotonic()
        fault = self._present_fault()
        if fault is not None and fault.code != ErrorCode.DEVICE_DISCONNECTED:
            raise RigError(ErrorCode.SAFETY_STILL_FAULTED, fault.detail, fault=str(fault.code))
        return fault

    def acknowledged_within(self, actor: str, within_s: float) -> bool:
        """Whether `actor` has acknowledged within this time."""
        return time.monotonic() - self._acknowledged_at.get(actor, -math.inf) <= within_s

    def latch_stop(self, actor: str) -> Latch:
        """Latches a stop of the whole cell by `actor`; returns the latch, or an older one that was closed already.

        Does not call `on_change`: whoever stops the cell has halted the devices before.
        """
        with self._latch_lock:
            detail = f"{actor} stopped the cell (POST /v1/rig/stop)"
            self._newest = Latch(ErrorCode.SAFETY_SOFTWARE_STOP, detail, time.time())
            self._stops += 1
            self._latch = self._latch or self._newest
            return self._latch

    def poll(self) -> None:
        """Checks the newest reading and latches a fault; the thread calls it every PERIOD_S."""
        fault = self._present_fault()
        if fault is None:
            return
        with self._latch_lock:
            is_latched = self._latch is not None
            if is_latched and fault.code == ErrorCode.DEVICE_DISCONNECTED:  # may be acknowledged while it lasts
                return
            latch = self._newest = Latch(fault.code, fault.detail.removesuffix("."), time.time())
            self._stops += 1
            if is_latched:
                return
            self._latch = latch
        self._on_change(latch)
        _log.error("%s: %s", latch.code, latch.detail)

    def _present_fault(self) -> states.Fault | None:
        reading = self._arm.reading
        fault = classify(reading)
        if reading.connected:
            self._was_connected = True
        elif (
            reading.taking_control or not self._was_connected
        ):  # silent, but not lost: the request for control succeeds or fails within 12 s
            return None
        return fault

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            try:
                self.poll()
            except Exception:  # noqa: BLE001 - nothing else sees the next fault: the thread must live on
                _log.exception("the latch is set, but handling the fault failed")
