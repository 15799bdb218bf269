"""Protocol of what publication, trace and URScript functions need of the controller.

The controller imports these three, so they cannot import its class without a circular import. They name what they use
of it instead, and a test can pass them a stand-in.
"""

import logging
from typing import Protocol

from hardware_sim.controller.arm import Arm
from hardware_sim.controller.collisions import Collisions
from hardware_sim.controller.interpreter import Interpreter
from hardware_sim.controller.messages import RobotMessage
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.registers import Registers
from hardware_sim.controller.safety import Safety
from hardware_sim.controller.script_links import ScriptLinks
from hardware_sim.controller.signals import Inputs, Outputs
from hardware_sim.controller.watchdogs import Watchdogs


class Robot(Protocol):
    """The state that clients and records see, and the actions that a program may order: `controller.Controller`."""

    arm: Arm
    registers: Registers
    inputs: Inputs
    outputs: Outputs
    collisions: Collisions
    safety: Safety
    slider: float
    runtime_state: RuntimeState
    speed_factor: float
    links: ScriptLinks
    interpreter: Interpreter
    watchdogs: Watchdogs
    now: float
    force_mode_settings: dict[str, float]

    @property
    def timestamp(self) -> float: ...
    @property
    def playing(self) -> bool: ...
    def announce(self, message: RobotMessage) -> None: ...
    def claim(self) -> None: ...
    def pause(self) -> bool: ...
    def protective_stop(self, why: str) -> None: ...
    def report(self, message: str, level: int = logging.WARNING) -> None: ...
    def require_main_program(self) -> None: ...
    def tool_changed(self) -> None: ...
