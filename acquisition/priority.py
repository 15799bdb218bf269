"""How urgent this process is: what keeps the arm safe comes before what computes and renders.

The driver's kicks must arrive within a quarter of a second also while every core is busy. Niceness alone does not see
to that: where Linux groups processes by terminal or container, it orders those of one group only, and two more groups
that compute were seen to hold up a driver for longer. So the driver runs in real time, before every ordinary process of
the machine; it sleeps most of each turn, and the kernel leaves the others a twentieth of every second whatever it does.
Both need a right that a service unit or container grants; without it the process runs on, the arm stops a little too
readily under load, and the log says so.
"""

import logging
import os

_log = logging.getLogger(__name__)

DRIVER = -10
SERVICE = -5
ORDINARY = 0
BACKGROUND = 10


def take_real_time() -> None:
    """Puts this process, and the threads that it starts from now on, before all ordinary ones; else by niceness."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))
    except PermissionError:
        _log.warning("not allowed to run in real time: other groups of processes may hold up this one")
        take(DRIVER)


def take(niceness: int) -> None:
    """Makes this process an ordinary one of some niceness, or logs that it may not."""
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except PermissionError:
        _log.warning("not allowed to run at niceness %d: a busy machine may stop the arm by its watchdog", niceness)
