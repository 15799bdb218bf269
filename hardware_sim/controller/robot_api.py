"""Robot API of PolyScope X (REST over HTTP, port 80), in place of the dashboard, which PolyScope X does not have.

Paths, actions and bodies are those of UR's C++ client library (`dashboard_client_implementation_x.cpp`, its tests) and
of the API's description 5.0.107 (PolyScope 10.14). In local control every request that changes something gets 403; only
a person at the pendant switches to remote control. Safety modes beyond the five published ones have RTDE's names.
"""

import json
import socket
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.modes import RuntimeState, SafetyMode
from hardware_sim.controller.sockets import Connection

BASE = "/universal-robots/robot-api"
_LONGEST = 1 << 16  # bytes of one request
_FORBIDDEN = "Not authorized to perform this operation under the current robot control mode."
_STATES = {RuntimeState.STOPPED: "STOPPED", RuntimeState.PAUSED: "PAUSED", RuntimeState.PAUSING: "PAUSED"}
_SAFETY = {
    SafetyMode.ROBOT_EMERGENCY_STOP: "EMERGENCY_STOP",
    SafetyMode.SYSTEM_EMERGENCY_STOP: "EMERGENCY_STOP",
    SafetyMode.VIOLATION: "FAULT",
}
Answer = tuple[HTTPStatus, dict[str, Any]]


class RobotApiConnection(Connection):
    """One HTTP client, whose requests are answered in order."""

    def __init__(self, stream: socket.socket, controller: Controller, shut_down: Callable[[], None]) -> None:
        super().__init__(stream)
        self._controller = controller
        self._shut_down = shut_down
        self._buffer = b""

    def received(self, data: bytes) -> None:
        """Answers each complete request; a client that sends too many bytes without one is disconnected."""
        self._buffer += data
        while not self.closed and b"\r\n\r\n" in self._buffer:
            head, _, rest = self._buffer.partition(b"\r\n\r\n")
            first, *lines = head.decode("latin-1").split("\r\n")
            fields = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
            words, length = first.split(" "), fields.get("content-length", "0")
            if len(words) != 3 or words[2] != "HTTP/1.1" or not length.isdecimal() or len(length) > 5:
                self._reply(HTTPStatus.BAD_REQUEST, {"message": "Bad Request"}, last=True)
            elif len(rest) < int(length):
                break
            else:
                body, self._buffer = rest[: int(length)], rest[int(length) :]
                status, content = answer(self._controller, words[0], words[1], body)
                self._reply(status, content, last=fields.get("connection", "").lower() == "close")
                if status is HTTPStatus.ACCEPTED:
                    self._shut_down()
        self.closed = self.closed or len(self._buffer) > 2 * _LONGEST

    def _reply(self, status: HTTPStatus, content: dict[str, Any], last: bool) -> None:
        body = json.dumps(content).encode()
        head = f"HTTP/1.1 {status} {status.phrase}\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        self.send(head.encode() + (b"Connection: close\r\n\r\n" if last else b"\r\n") + body)
        self.flush()
        self.closed = self.closed or last


def answer(controller: Controller, method: str, target: str, body: bytes) -> Answer:
    """Carries out one request and returns the status and the body of its answer."""
    route = _ROUTES.get((method, target.removeprefix(BASE).rstrip("/"))) if target.startswith(BASE) else None
    if route is None:
        return HTTPStatus.NOT_FOUND, {"message": "Not Found"}
    try:
        content = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        return HTTPStatus.UNPROCESSABLE_ENTITY, {"message": "Validation Error"}
    if method != "GET" and not controller.safety.remote_control:
        return HTTPStatus.FORBIDDEN, {"message": "Forbidden", "details": _FORBIDDEN}
    return route(controller, content)


def _get(**fields: Callable[[Controller], Any]) -> Callable[[Controller, dict[str, Any]], Answer]:
    return lambda c, _: (HTTPStatus.OK, {name: value(c) for name, value in fields.items()})


def _acting(**actions: Callable[[Controller], object]) -> Callable[[Controller, dict[str, Any]], Answer]:
    """Carries out an action by name; False or a reason from it means that the present state does not permit it."""

    def act(controller: Controller, content: dict[str, Any]) -> Answer:
        action = actions.get(str(content.get("action")))
        if action is None:
            return HTTPStatus.UNPROCESSABLE_ENTITY, {"message": f"action must be one of {', '.join(actions)}"}
        refusal = action(controller)
        if refusal is False or isinstance(refusal, str):
            return HTTPStatus.CONFLICT, {
                "message": "Conflict",
                "details": refusal or "not allowed in the present state",
            }
        return HTTPStatus.OK, {"message": "State changed successfully"}

    return act


def _load(controller: Controller, content: dict[str, Any]) -> Answer:
    if controller.load_file(f"{content.get('name')}.urp"):
        return HTTPStatus.OK, {"message": "Program loaded"}
    return HTTPStatus.NOT_FOUND, {"message": "Program not found"}


_ROUTES: dict[tuple[str, str], Callable[[Controller, dict[str, Any]], Answer]] = {
    ("GET", "/openapi.json"): _get(info=lambda c: {"title": "Robot API", "version": "5.0.107"}),
    ("GET", "/robotstate/v1/robotmode"): _get(mode=lambda c: c.safety.robot_mode.name),
    ("GET", "/robotstate/v1/safetymode"): _get(
        mode=lambda c: _SAFETY.get(c.safety.safety_mode, c.safety.safety_mode.name)
    ),
    ("PUT", "/robotstate/v1/state"): _acting(
        UNLOCK_PROTECTIVE_STOP=lambda c: c.safety.unlock(),
        RESTART_SAFETY=lambda c: c.safety.restart(),
        POWER_OFF=lambda c: c.power_off(),
        POWER_ON=lambda c: c.safety.power_on(),
        BRAKE_RELEASE=lambda c: c.safety.release_brakes(),
    ),
    ("GET", "/program/v1/state"): _get(state=lambda c: _STATES.get(c.runtime_state, "PLAYING")),
    ("PUT", "/program/v1/state"): _acting(
        play=lambda c: c.runtime_state is RuntimeState.STOPPED and c.play(),
        pause=lambda c: c.pause(),
        resume=lambda c: c.runtime_state is not RuntimeState.STOPPED and c.play(),
        stop=lambda c: c.stop_program("by the Robot API"),
    ),
    ("GET", "/program/v1/loaded"): _get(name=lambda c: "" if c.loaded is None else c.loaded.name.removesuffix(".urp")),
    ("PUT", "/program/v1/loaded"): _load,
    ("GET", "/system/v1/controlmode"): _get(mode=lambda c: "REMOTE" if c.safety.remote_control else "LOCAL"),
    ("GET", "/system/v1/operationalmode"): _get(mode=lambda c: "AUTOMATIC"),
    ("GET", "/system/v1/information"): _get(
        robotType=lambda c: c.arm.model.name.upper().removesuffix("E"), serialNumber=lambda c: c.serial
    ),
    ("GET", "/versions/v1"): _get(marketingVersion=lambda c: ".".join(map(str, c.version[:3]))),
    ("PUT", "/system/v1/shutdown"): lambda c, _: (HTTPStatus.ACCEPTED, {"message": None}),
}
