"""Runs the simulated controller for lightpose: in real time, ahead of the machine's other work.

`hardware_sim.controller` imports only the standard library, so that it serves other projects' tests as a package of its
own (`hardware_sim.ur_sim_project`). This module adds scheduling and the service's errors.

    python -m hardware_sim.real_time_controller      takes the options of `python -m hardware_sim.controller`
"""

import sys
from collections.abc import Generator
from contextlib import contextmanager

from acquisition import process_priority
from acquisition.models.errors import ErrorCode, RigError
from acquisition.process_priority import RealTime
from hardware_sim.controller.__main__ import main
from hardware_sim.controller.options import ControllerOptions
from hardware_sim.controller.process import ControllerProcess

SHARE = 0.4
"""Largest share of a core in real time. A moving arm at speed 20 takes 0.2; a real controller has its own machine."""


@contextmanager
def as_rig_errors() -> Generator[None]:
    """Converts errors of a controller's process or client to RigError: device.disconnected, request.invalid."""
    try:
        yield
    except ConnectionError as error:
        raise RigError(ErrorCode.DEVICE_DISCONNECTED, str(error)) from error
    except ValueError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, str(error)) from error


def start(address: str, options: ControllerOptions, *, log_level: str = "WARNING") -> ControllerProcess:
    """Starts a controller, in real time if that is permitted. Raises RigError request.invalid if it does not start."""
    try:
        return ControllerProcess(address, options, log_level=log_level, module=__name__)
    except ConnectionError as error:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"no simulated controller starts at {address}: choose a loopback address of which no other program uses "
            "the controller's ports, such as 127.0.0.2",
            address=address,
        ) from error


if __name__ == "__main__":
    process_priority.set_niceness(process_priority.DRIVER)
    sys.exit(main(RealTime(SHARE)))
