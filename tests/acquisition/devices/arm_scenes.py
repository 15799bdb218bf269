"""A simulated controller, an arm that talks to it, and moves that a test can interrupt."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from acquisition.devices import MotionLimits, StopToken
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from acquisition.models import cell_config
from acquisition.models.cell_config import ArmConfig, CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import real_time_controller
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from hardware_sim.nominal import ROBOT_API_PORT

CELL: CellConfig = cell_config.load(Path(__file__).parents[3] / "hardware_sim" / "cells" / "cell.sim.toml")
LIMITS = MotionLimits(1.05, 1.4)
HOME = CELL.arm.home
FAR = (HOME[0] - 4.0, *HOME[1:])  # over four seconds away
NEAR = (HOME[0] + 0.05, *HOME[1:])

SERVICE_CODE = """
from acquisition.devices import StopToken
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from tests.acquisition.devices.arm_scenes import CELL, FAR, LIMITS, arm_config
arm = UrArm(arm_config({address!r}), CELL.lamp.output)
arm.connect()
UrLamp(arm, CELL.lamp).set(True)
arm.move([FAR], [LIMITS], StopToken())
"""
"""The program of a service that moves the arm, for a process of its own; to be formatted with the address."""


def arm_config(address: str, polyscope: str = "5") -> ArmConfig:
    """The simulated cell's arm at another address, with this software."""
    software = {"polyscope": polyscope, "robot_api_port": ROBOT_API_PORT}
    return CELL.arm.model_copy(update={"address": address} | software)


@contextmanager
def controller(address: str, record: Path | None = None, polyscope: str = "5") -> Iterator[ControlClient]:
    """A controller process; yields a client of its control port."""
    options = ControllerOptions(
        home=HOME, low_when_stopped=(0,), record=record, polyscope=polyscope, robot_api_port=ROBOT_API_PORT
    )
    with (
        real_time_controller.start(address, options) as process,
        process.control() as control,
    ):
        yield control


@contextmanager
def connected(arm: UrArm) -> Iterator[UrArm]:
    """An arm under control; closed at the end whatever happens."""
    try:
        arm.connect()
        yield arm
    finally:
        arm.close()


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    """Waits for something that must come; the limit only keeps a failed test from hanging."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


def speed(state: dict[str, Any]) -> float:
    """The fastest joint's speed, rad/s."""
    return max(map(abs, state["joint_speeds"]))


def wait_until_moving(control: ControlClient) -> dict[str, Any]:
    """Waits for full speed; returns the state then."""
    wait_for(lambda: speed(control.state()) > 1.0)
    return control.state()


def wait_until_at_rest(control: ControlClient) -> dict[str, Any]:
    """Waits for rest; returns the first state seen there."""
    wait_for(lambda: speed(control.state()) == 0.0)
    return control.state()


def stays_at_rest(control: ControlClient, seconds: float = 0.4) -> bool:
    """Whether no joint moves and no move begins for a while."""
    before = control.state()
    time.sleep(seconds)
    after = control.state()
    return after["joints"] == before["joints"] and after["moves_started"] == before["moves_started"]


@dataclass
class Journey:
    """A move in a thread of its own, as the runner makes it, and how it ended."""

    arm: UrArm
    path: Sequence[Sequence[float]] = (FAR,)
    stop: StopToken = field(default_factory=StopToken)
    outcome: Exception | None = None

    def __post_init__(self) -> None:
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.arm.move(self.path, [LIMITS] * len(self.path), self.stop)
        except Exception as error:  # noqa: BLE001 - whatever it is, the test looks at it
            self.outcome = error

    def wait_until_moving(self, control: ControlClient) -> dict[str, Any]:
        """Waits for full speed; returns the state then. Raises what ended the move before."""

        def fast_or_over() -> bool:
            return speed(control.state()) > 1.0 or not self._thread.is_alive()

        wait_for(fast_or_over)
        if self.outcome is not None:
            raise self.outcome
        return control.state()

    def end(self) -> Exception | None:
        """Waits for the move to return; its error, or None."""
        self._thread.join(90.0)
        assert not self._thread.is_alive(), "move() did not return"
        return self.outcome


LOAD = (ErrorCode.ARM_MOVE_FAILED, ErrorCode.ARM_NOT_READY, ErrorCode.DEVICE_DISCONNECTED, ErrorCode.DRIVER_LOST)
"""What ends a move when the machine keeps service, driver or controller waiting for longer than the lease of 0.2 s."""


def until_undisturbed(act: Callable[[], object]) -> None:
    """Does it again, nine times at most, when the machine's load has ended it."""
    for _ in range(9):
        try:
            act()
        except RigError as error:
            if error.code not in LOAD:
                raise
            continue
        return
    act()


def moved(arm: UrArm, path: Sequence[Sequence[float]] = (HOME,), limits: Sequence[MotionLimits] | None = None) -> None:
    """Moves the arm to the end of a path; once more, connected anew, where the machine's load has ended a move.

    For a test that needs the arm there. Where the move itself is what is tested, nothing may connect in between.
    """

    def move() -> None:
        if not arm.reading.connected or not arm.reading.program_running:
            arm.connect()
        arm.move(path, [LIMITS] * len(path) if limits is None else limits, StopToken())

    until_undisturbed(move)


def under_way(
    arm: UrArm, control: ControlClient, path: Sequence[Sequence[float]] = (FAR,)
) -> tuple[Journey, dict[str, Any]]:
    """A move at full speed, and the state then; begun again, connected anew, where the machine's load has ended it."""
    begun: list[tuple[Journey, dict[str, Any]]] = []

    def begin() -> None:
        if not arm.reading.connected or not arm.reading.program_running:
            arm.connect()
            UrLamp(arm, CELL.lamp).set(True)
        journey = Journey(arm, path)
        begun.append((journey, journey.wait_until_moving(control)))

    until_undisturbed(begin)
    return begun[-1]
