"""What publication, trace and URScript functions need of the controller, as Protocols.

The controller imports these three to run them; were they to name its class, the imports would run in a circle. So they
name what they use of it, and a test can hand them a stand-in.
"""

import logging
from typing import Protocol

from hardware_sim.controller.arm import Arm
from hardware_sim.controller.collisions import Collisions
from hardware_sim.controller.inputs import Inputs
from hardware_sim.controller.interpreter import Interpreter
from hardware_sim.controller.messages import RobotMessage
from hardware_sim.controller.modes import RobotMode, RuntimeState, SafetyMode
from hardware_sim.controller.outputs import Outputs
from hardware_sim.controller.registers import Registers
from hardware_sim.controller.script_links import ScriptLinks


class RobotState(Protocol):
    """The state that clients and records see."""

    arm: Arm
    registers: Registers
    inputs: Inputs
    outputs: Outputs
    collisions: Collisions
    slider: float
    runtime_state: RuntimeState

    @property
    def timestamp(self) -> float:
        """Seconds since power-on."""
        ...

    @property
    def playing(self) -> bool:
        """Whether a program plays."""
        ...

    @property
    def robot_mode(self) -> RobotMode:
        """What power and brakes do."""
        ...

    @property
    def safety_mode(self) -> SafetyMode:
        """Why the arm may not move, if so."""
        ...


class Robot(RobotState, Protocol):
    """The state, and what a program may order."""

    speed_factor: float
    links: ScriptLinks
    interpreter: Interpreter
    force_mode_settings: dict[str, float]

    def announce(self, message: RobotMessage) -> None:
        """Has the ports send a message to clients that listen."""
        ...

    def claim(self) -> None:
        """Keeps the present motion going for one more tick."""
        ...

    def pause(self) -> bool:
        """Pauses the program; returns whether one was playing."""
        ...

    def protective_stop(self, why: str) -> None:
        """Brakes at once and pauses the program until somebody unlocks."""
        ...

    def report(self, message: str, level: int = logging.WARNING) -> None:
        """Writes to the log and keeps the message for the control port."""
        ...

    def require_main_program(self) -> None:
        """Raises ScriptError where a secondary program tries to move the arm."""
        ...

    def set_watchdog(self, variable: str, frequency: float, action: str) -> None:
        """Arms a watchdog for the program's life; frequency in Hz."""
        ...

    def tool_changed(self) -> None:
        """Publishes the pose after the TCP was set while the arm stands."""
        ...
