"""Scheduling priority of a process: what keeps the arm safe comes before what computes and renders.

The driver's kicks and the service's lease must arrive within a quarter of a second even while every core is busy.
Niceness orders only the processes of one scheduling group (a terminal, a container): beside other computing groups, a
service waited for 0.7 s. The real-time class (`sched(7)`) comes before all groups, but nothing ordinary runs meanwhile.
So a process enters it only after its start-up work and while it matters, and stays within a share of one core that it
measures itself (decision 53). Raising a priority needs a right that a service unit or container grants. Without it the
process runs on, and the arm stops a little too readily beside other programs.
"""

import ctypes
import logging
import os
import resource
import signal
import time
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from types import FrameType

_log = logging.getLogger(__name__)

DRIVER = -10
SERVICE = -5
BACKGROUND = 10
"""Niceness (−20 to 19, lower is more urgent) of the arm's driver, the service, and computing processes."""

WINDOW_S = 1.0
"""Period, s, over which the share of a core is measured."""

SPIN_S, SPIN_AT_MOST_S = 0.2, 1.0
"""Processor time, s, without any wait, after which a thread loses the real-time class, and after which the kernel ends
the process. A turn of the driver takes 1 ms."""

SWITCH = "LIGHTPOSE_REAL_TIME"
"""Environment variable; `no` disables the real-time class."""

_OOM_SCORE = 1000
"""The highest `oom_score_adj`: above any other process's score, whatever its size. Raising it needs no right."""

_RESIDENT_ONLY = 1 | 4  # MCL_CURRENT | MCL_ONFAULT: what is mapped now, once it is in memory


class Priority(IntEnum):
    """What a process was granted."""

    ORDINARY = 1
    NICENESS = 2
    REAL_TIME = 3


def set_niceness(niceness: int) -> bool:
    """Sets the niceness of this thread and of those that it starts. Returns whether that is allowed."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except PermissionError:
        return False
    return True


def end_first_without_memory() -> None:
    """Makes the kernel end this process before any other when memory runs out (`oom_score_adj`, proc(5))."""
    with suppress(OSError):  # a container may hide the file: then the kernel decides by size alone
        Path("/proc/self/oom_score_adj").write_text(str(_OOM_SCORE), encoding="ascii")


class RealTime:
    """The real-time class (SCHED_RR, lowest priority) for all threads of this process, within a share of one core.

    Only one thread may use it: its loop calls `enter` when start-up work is done and whenever threads have been started
    since, `leave` before further such work, and `keep_share` once a turn.
    """

    def __init__(self, share: float) -> None:
        """`share` is that of one core over WINDOW_S. A process that has used it up is ordinary until the window ends.

        With a share of 0 the process stays ordinary.
        """
        self._share_s = share * WINDOW_S
        self._granted = None if share > 0 else False  # none: not asked for yet
        self._wanted = self._inside = self._locked = self._warned = False
        self._window_begun = time.monotonic()
        self._spent_s = 0.0  # processor time inside, in this window
        self._counted_to = 0.0  # time.process_time() up to which it is

    @property
    def granted(self) -> bool:
        """Whether this process may enter the real-time class; False before the first `enter`."""
        return bool(self._granted)

    def enter(self) -> None:
        """Puts every thread into the real-time class and keeps memory from being paged out, where that is permitted."""
        self._wanted = True
        if self._granted is None:
            self._granted = _may_be_real_time()
        if self._granted and self._count() <= self._share_s:
            self._go_inside()

    def leave(self) -> None:
        """Makes every thread an ordinary one again."""
        self._wanted = False
        if self._granted:
            self._count()
            self._go_outside()

    def keep_share(self) -> None:
        """Leaves the real-time class for the rest of the window once the share is used up; called once a turn."""
        if not self._granted:
            return
        within = self._count() <= self._share_s
        if self._inside and not within:
            if not self._warned:
                self._warned = True
                _log.warning(
                    "used more than %.0f %% of a core: real-time scheduling is suspended until the window ends",
                    100 * self._share_s / WINDOW_S,
                )
            self._go_outside()
        elif self._wanted and within and not self._inside:
            self._go_inside()

    def _count(self) -> float:
        """Processor time, s, spent in the real-time class in this window."""
        now, used = time.monotonic(), time.process_time()
        if self._inside:
            self._spent_s += used - self._counted_to
        self._counted_to = used
        if now - self._window_begun >= WINDOW_S:
            self._window_begun, self._spent_s = now, 0.0
        return self._spent_s

    def end_what_spins(self) -> None:
        """Makes the kernel end this process when a thread runs for SPIN_AT_MOST_S without a wait: an endless loop."""
        _, hard = resource.getrlimit(resource.RLIMIT_RTTIME)
        limit = int(1e6 * SPIN_AT_MOST_S)
        limit = limit if hard == resource.RLIM_INFINITY else min(hard, limit)
        signal.signal(signal.SIGXCPU, self._spun)
        resource.setrlimit(resource.RLIMIT_RTTIME, (min(int(1e6 * SPIN_S), limit), limit))

    def _spun(self, _: int, __: FrameType | None) -> None:
        self._go_outside()

    def _go_inside(self) -> None:
        self._inside = True
        self._set(os.SCHED_RR, os.sched_get_priority_min(os.SCHED_RR))
        if not self._locked:
            self._locked = True
            _lock_memory()

    def _go_outside(self) -> None:
        if self._inside:
            self._inside = False
            self._set(os.SCHED_OTHER, 0)

    @staticmethod
    def _set(policy: int, priority: int) -> None:
        """Sets the policy of each thread; one that has just ended is skipped. What a thread starts is ordinary."""
        for thread in Path("/proc/self/task").iterdir():
            try:
                os.sched_setscheduler(int(thread.name), policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
            except ProcessLookupError:
                continue


def _may_be_real_time() -> bool:
    if os.environ.get(SWITCH, "yes") == "no":
        return False
    before = os.sched_getscheduler(0)
    try:
        lowest = os.sched_param(os.sched_get_priority_min(os.SCHED_RR))
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, lowest)
    except PermissionError:
        return False
    os.sched_setscheduler(0, before | os.SCHED_RESET_ON_FORK, os.sched_param(0))
    return True


def _lock_memory() -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_RESIDENT_ONLY):
        _log.debug("memory is not locked: %s", os.strerror(ctypes.get_errno()))
