"""The dashboard server: one line of text in, one line out (port 29999).

Replies are compared whole by the clients, so they are the real ones, ended by a bare line feed.
"""

import socket
from collections.abc import Callable

from hardware_sim.controller.controller import VERSION, Controller
from hardware_sim.controller.modes import RobotMode, RuntimeState
from hardware_sim.controller.sockets import LineConnection

PORT = 29999
_LOCAL = "Command is not allowed: the robot is in local control"


class DashboardConnection(LineConnection):
    """One dashboard client."""

    def __init__(self, stream: socket.socket, controller: Controller) -> None:
        super().__init__(stream)
        self._controller = controller
        self.send(b"Connected: Universal Robots Dashboard Server\n")

    def line(self, text: str) -> None:
        """Answers one request."""
        command = text.strip()
        if command:
            self.send((answer(self._controller, command) + "\n").encode())
        if command.lower() in ("quit", "shutdown"):
            self.flush()
            self.closed = True


def answer(controller: Controller, command: str) -> str:
    """Carries out one dashboard command and returns its reply; letter case of the command does not matter."""
    words = command.lower().split()
    exact = _EXACT.get(" ".join(words))
    if exact is not None:
        return exact(controller)
    argument = command[len(command.split(maxsplit=1)[0]) :].strip()
    if words[0] == "load":
        return f"File not found: {argument}"
    if words[0] == "popup":
        controller.popup = argument
        return "showing popup"
    if words[0] == "addtolog":
        controller.report(f"addToLog: {argument}")
        return "Added log message"
    if words[0] == "setuserrole":
        return f"Setting user role: {argument}"
    return f'could not understand: "{command}"'


def _stop(controller: Controller) -> str:
    # "Stopped" also where nothing runs: the library stops programs that have just ended by themselves.
    controller.stop_program("by the dashboard")
    return "Stopped"


def _moving(name: str, reply: str, action: Callable[[Controller], object]) -> Callable[[Controller], str]:
    """A command that remote control must allow and that fails where `action` returns False."""

    def run(controller: Controller) -> str:
        if not controller.remote_control:
            return _LOCAL
        return f"Failed to execute: {name}" if action(controller) is False else reply

    return run


def _plain(reply: str, action: Callable[[Controller], object]) -> Callable[[Controller], str]:
    def run(controller: Controller) -> str:
        action(controller)
        return reply

    return run


def _unlock(controller: Controller) -> str:
    return controller.unlock() or "Protective stop releasing"


def _state(controller: Controller) -> str:
    if controller.runtime_state is RuntimeState.STOPPED:
        return "STOPPED"
    paused = controller.runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING)
    return "PAUSED" if paused else "PLAYING"


def _program_state(controller: Controller) -> str:
    return f"{_state(controller)} {controller.program_name or '<unnamed>'}"


def _safety_name(controller: Controller) -> str:
    return controller.safety_mode.name


def _close_popup(controller: Controller) -> None:
    controller.popup = None


def _restart_safety(controller: Controller) -> None:
    controller.restart_safety()


def _robot_mode(controller: Controller) -> str:
    return f"Robotmode: {RobotMode(controller.robot_mode).name}"


def _version(controller: Controller) -> str:
    del controller
    return "URSoftware {}.{}.{}.{} (Aug 05 2021)".format(*VERSION)


def _is_saved(controller: Controller) -> str:
    return f"true {controller.program_name}" if controller.program_name else "false <unnamed>"


_EXACT: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": _version,
    "version": _version,
    "get serial number": lambda c: c.serial,
    "get robot model": lambda c: c.arm.model.name.upper().removesuffix("E"),
    "is in remote control": lambda c: str(c.remote_control).lower(),
    "play": _moving("play", "Starting program", lambda c: c.play()),
    "pause": _moving("pause", "Pausing program", lambda c: c.pause()),
    "stop": _stop,
    "running": lambda c: f"Program running: {str(c.runtime_state is not RuntimeState.STOPPED).lower()}",
    "programstate": _program_state,
    "get loaded program": lambda c: "No program loaded",
    "isprogramsaved": _is_saved,
    "robotmode": _robot_mode,
    "safetymode": lambda c: f"Safetymode: {_safety_name(c)}",
    "safetystatus": lambda c: f"Safetystatus: {_safety_name(c)}",
    "unlock protective stop": _unlock,
    "power on": _moving("power on", "Powering on", lambda c: c.power_on()),
    "power off": _moving("power off", "Powering off", lambda c: c.power_off()),
    "brake release": _moving("brake release", "Brake releasing", lambda c: c.release_brakes()),
    "close popup": _plain("closing popup", _close_popup),
    "close safety popup": _plain("closing safety popup", _close_popup),
    "restart safety": _plain("Restarting safety", _restart_safety),
    "popup": _plain("showing popup", lambda c: None),
    "quit": lambda c: "Disconnected",
    "shutdown": _plain("Shutting down", lambda c: c.power_off()),
}
