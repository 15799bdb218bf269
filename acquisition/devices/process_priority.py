"""Scheduling priority of a process: what keeps the arm safe comes before what computes and renders.

The driver's kicks and the service's lease must arrive within a quarter of a second also while every core is busy; on a
loaded machine an ordinary process was seen to wait that long. Raising a priority needs a right that a service unit or
container grants; without it the process runs on, the arm stops a little too readily under load, and the log says so.
"""

import logging
import os

_log = logging.getLogger(__name__)

DRIVER = -10
SERVICE = -5
BACKGROUND = 10
"""Niceness (−20 to 19, lower is more urgent) of the arm's driver, the service, and computing processes."""


def set_niceness(niceness: int) -> None:
    """Sets this process's niceness, or logs that it may not."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except PermissionError:
        _log.warning("not allowed to run at niceness %d: a busy machine may stop the arm by its watchdog", niceness)
