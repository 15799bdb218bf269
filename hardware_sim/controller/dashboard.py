"""Dashboard server (UR dashboard server guide, e-Series): one line of text in, one line out (port 29999).

It has all commands of PolyScope 5.11. Where the guide differs from what robots send (operational modes), replies are
those that UR's own client library expects. `setUserRole` and `getUserRole` belong to CB3, but clients still send them.
Clients compare whole replies, so these are the real ones, ended by a bare line feed. In local control a controller
answers questions, shows popups and refuses all else. A connection that was opened in local control goes on refusing
until the client connects again.
"""

import socket
from collections.abc import Callable

from hardware_sim.controller import program_store
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
    """Carries out one dashboard command, in any letter case, and returns its reply."""
    lowered = command.lower()
    question = _ALWAYS.get(lowered)
    if question is not None:
        return question(controller)
    action = _REMOTE.get(lowered)
    if action is not None:
        return action(controller) if remote else _REFUSED
    for prefix, (needs_remote, carry_out) in _WITH_ARGUMENT.items():
        if lowered.startswith(prefix + " "):
            return carry_out(controller, command[len(prefix) + 1 :]) if remote or not needs_remote else _REFUSED
    return f'could not understand: "{command}"'


def _add_to_log(controller: Controller, text: str) -> str:
    controller.report(f"addToLog: {text}")
    return "Added log message"


def _load(controller: Controller, name: str) -> str:
    return f"Loading program: {name}" if controller.load_file(name) else f"File not found: {name}"


def _load_installation(controller: Controller, name: str) -> str:
    if not program_store.has_installation(controller.programs, name):
        return f"File not found: {name}"
    controller.stop_program(f"{name} is loaded")
    return f"Loading installation: {name}"


def _support_file(controller: Controller, directory: str) -> str:
    try:
        name = program_store.support_file(controller.programs, directory, controller.serial, controller.messages)
    except OSError as error:
        return f"Error: {error}"
    return f"Completed successfully: {name}" if name else f"Error: no directory {directory}"


def _checked(name: str, reply: str, action: Callable[[Controller], bool]) -> Callable[[Controller], str]:
    return lambda controller: reply if action(controller) else f"Failed to execute: {name}"


def _plain(reply: str, action: Callable[[Controller], object]) -> Callable[[Controller], str]:
    def run(controller: Controller) -> str:
        action(controller)
        return reply

    return run


def _program_state(controller: Controller) -> str:
    state = "PLAYING"
    if controller.runtime_state is RuntimeState.STOPPED:
        state = "STOPPED"
    elif controller.runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
        state = "PAUSED"
    return f"{state} {controller.program_name or '<unnamed>'}"


def _setting(field: str, value: str | None, reply: str) -> Callable[[Controller], str]:
    return _plain(reply, lambda controller: setattr(controller.safety, field, value))


_NUMBER = ".".join(map(str, VERSION))
_MODES = ("MANUAL", "AUTOMATIC")
_ROLES = ("PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED")
_ALWAYS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": lambda c: f"URSoftware {_NUMBER} (Aug 05 2021)",
    "version": lambda c: _NUMBER,
    "get serial number": lambda c: c.serial,
    "get robot model": lambda c: c.arm.model.name.upper().removesuffix("E"),
    "get operational mode": lambda c: c.safety.operational_mode,
    "clear operational mode": _setting(
        "operational_mode", "NONE", "No longer controlling the operational mode. Current operational mode: 'NONE'."
    ),
    "getuserrole": lambda c: c.safety.user_role,
    "addtolog": lambda c: "No log message to add",
    "savelog": lambda c: "Log saved to disk",  # it is kept anyway: `log` of the control port
    "is in remote control": lambda c: str(c.safety.remote_control).lower(),
    "running": lambda c: f"Program running: {str(c.runtime_state is not RuntimeState.STOPPED).lower()}",
    "programstate": _program_state,
    "get loaded program": lambda c: f"Loaded program: {c.loaded.path}" if c.loaded else "No program loaded",
    "isprogramsaved": lambda c: "false <unnamed>" if c.loaded is None else f"true {c.loaded.name}",
    "robotmode": lambda c: f"Robotmode: {c.safety.robot_mode.name}",
    "safetymode": lambda c: f"Safetymode: {c.safety.safety_mode.name}",
    "safetystatus": lambda c: f"Safetystatus: {c.safety.safety_mode.name}",
    "popup": _plain("showing popup", lambda c: None),
    "close popup": _setting("popup", None, "closing popup"),
    "close safety popup": _setting("safety_popup", None, "closing safety popup"),
    "quit": lambda c: "Disconnected",
    **{
        f"set operational mode {m.lower()}": _setting("operational_mode", m, f"Operational mode {m} is set")
        for m in _MODES
    },
    **{f"setuserrole {r.lower()}": _setting("user_role", r, f"Setting user role: {r.lower()}") for r in _ROLES},
    **{
        f"generate flight report{kind}": lambda c: f"Flight Report generated with id: {c.ticks}"
        for kind in ("", " controller", " software", " system")
    },
}
_REMOTE: dict[str, Callable[[Controller], str]] = {
    "play": _checked("play", "Starting program", Controller.play),
    "pause": _checked("pause", "Pausing program", Controller.pause),
    # "Stopped" even if nothing runs, because the library stops programs that have just ended by themselves.
    "stop": _plain("Stopped", lambda c: c.stop_program("by the dashboard")),
    "unlock protective stop": lambda c: c.safety.unlock() or "Protective stop releasing",
    "power on": _plain("Powering on", lambda c: c.safety.power_on()),
    "power off": _plain("Powering off", lambda c: c.power_off()),
    "brake release": _plain("Brake releasing", lambda c: c.safety.release_brakes()),
    "restart safety": _plain("Restarting safety", lambda c: c.safety.restart()),
    "shutdown": lambda c: "Shutting down",
}
_WITH_ARGUMENT: dict[str, tuple[bool, Callable[[Controller, str], str]]] = {
    "popup": (False, lambda c, text: _setting("popup", text, "showing popup")(c)),
    "addtolog": (False, _add_to_log),
    "generate support file": (False, _support_file),
    "load installation": (True, _load_installation),
    "load": (True, _load),
}
"""Commands with an argument, and whether they need remote control; a longer name comes before its own prefix."""
