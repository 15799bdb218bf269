"""Dashboard server (UR dashboard server guide): one line of text in, one line out (port 29999).

Replies are compared whole by the clients, so they are the real ones, ended by a bare line feed. In local control a
controller answers questions and shows popups, and refuses all else; it goes on refusing on connections that were opened
in local control until they are opened anew.
"""

import socket
from collections.abc import Callable

from hardware_sim.controller.controller import VERSION, Controller
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.sockets import LineConnection

PORT = 29999
_REFUSED = (
    "Command is not allowed due to safety reasons, "
    "please switch robot to Remote Control mode and reconnect to port 29999"
)


class DashboardConnection(LineConnection):
    """One dashboard client."""

    def __init__(self, stream: socket.socket, controller: Controller, shut_down: Callable[[], None]) -> None:
        super().__init__(stream)
        self._controller = controller
        self._shut_down = shut_down
        self._opened_remotely = controller.safety.remote_control
        self.send(b"Connected: Universal Robots Dashboard Server\n")

    def line(self, text: str) -> None:
        """Answers one request."""
        command = " ".join(text.split())
        if not command:
            return
        reply = answer(self._controller, command, self._opened_remotely and self._controller.safety.remote_control)
        self.send((reply + "\n").encode())
        if reply == "Disconnected":
            self.flush()
            self.closed = True
        elif reply == "Shutting down":
            self.flush()
            self._shut_down()


def answer(controller: Controller, command: str, remote: bool) -> str:
    """Carries out one dashboard command and returns its reply; letter case of the command does not matter."""
    lowered = command.lower()
    question = _ALWAYS.get(lowered)
    if question is not None:
        return question(controller)
    verb, _, argument = command.partition(" ")
    verb = verb.lower()
    if verb == "popup":
        controller.safety.popup = argument
        return "showing popup"
    if verb == "addtolog" and argument:
        controller.report(f"addToLog: {argument}")
        return "Added log message"
    if verb == "setuserrole" and argument:
        return f"Setting user role: {argument}"
    action = _REMOTE.get(lowered)
    if action is None and not (verb == "load" and argument):
        return f'could not understand: "{command}"'
    if not remote:
        return _REFUSED
    if action is not None:
        return action(controller)
    return f"Loading program: {argument}" if controller.load_file(argument) else f"File not found: {argument}"


def _stop(controller: Controller) -> str:
    # "Stopped" also where nothing runs: the library stops programs that have just ended by themselves.
    controller.stop_program("by the dashboard")
    return "Stopped"


def _checked(name: str, reply: str, action: Callable[[Controller], bool]) -> Callable[[Controller], str]:
    return lambda controller: reply if action(controller) else f"Failed to execute: {name}"


def _plain(reply: str, action: Callable[[Controller], object]) -> Callable[[Controller], str]:
    def run(controller: Controller) -> str:
        action(controller)
        return reply

    return run


def _unlock(controller: Controller) -> str:
    return controller.safety.unlock() or "Protective stop releasing"


def _program_state(controller: Controller) -> str:
    state = "PLAYING"
    if controller.runtime_state is RuntimeState.STOPPED:
        state = "STOPPED"
    elif controller.runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
        state = "PAUSED"
    return f"{state} {controller.program_name or '<unnamed>'}"


def _loaded(controller: Controller) -> str:
    return "No program loaded" if controller.loaded is None else f"Loaded program: {controller.loaded.name}"


def _close_popup(controller: Controller) -> None:
    controller.safety.popup = None


def _close_safety_popup(controller: Controller) -> None:
    controller.safety.safety_popup = None


_NUMBER = ".".join(map(str, VERSION))
_ALWAYS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": lambda c: f"URSoftware {_NUMBER} (Aug 05 2021)",
    "version": lambda c: _NUMBER,
    "get serial number": lambda c: c.serial,
    "get robot model": lambda c: c.arm.model.name.upper().removesuffix("E"),
    "get operational mode": lambda c: "NONE",
    "is in remote control": lambda c: str(c.safety.remote_control).lower(),
    "running": lambda c: f"Program running: {str(c.runtime_state is not RuntimeState.STOPPED).lower()}",
    "programstate": _program_state,
    "get loaded program": _loaded,
    "isprogramsaved": lambda c: "false <unnamed>" if c.loaded is None else f"true {c.loaded.name}",
    "robotmode": lambda c: f"Robotmode: {c.robot_mode.name}",
    "safetymode": lambda c: f"Safetymode: {c.safety_mode.name}",
    "safetystatus": lambda c: f"Safetystatus: {c.safety_mode.name}",
    "popup": _plain("showing popup", lambda c: None),
    "close popup": _plain("closing popup", _close_popup),
    "close safety popup": _plain("closing safety popup", _close_safety_popup),
    "quit": lambda c: "Disconnected",
}
_REMOTE: dict[str, Callable[[Controller], str]] = {
    "play": _checked("play", "Starting program", Controller.play),
    "pause": _checked("pause", "Pausing program", Controller.pause),
    "stop": _stop,
    "unlock protective stop": _unlock,
    "power on": _plain("Powering on", lambda c: c.safety.power_on()),
    "power off": _plain("Powering off", lambda c: c.power_off()),
    "brake release": _plain("Brake releasing", lambda c: c.safety.release_brakes()),
    "restart safety": _plain("Restarting safety", lambda c: c.safety.restart()),
    "shutdown": lambda c: "Shutting down",
}
