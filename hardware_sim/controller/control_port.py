"""Control port of the simulator (30200): true state of the arm, faults on demand, surroundings.

Requests and replies are one JSON object per line. A reply carries `"ok"`, and `"error"` if that is false. No real
controller has this port; only the simulated world, tests and graders use it. From Python: `control.ControlClient`.
Fields that a command does not take are refused.

    {"command": "state"}                            the true state, see `state`
    {"command": "fault", "kind": …, …}              orders a fault; `faults` lists all kinds
    {"command": "collisions"}                       all collisions so far, oldest first
    {"command": "log"}                              the latest messages
    {"command": "input", "digital": n, "level": …}  sets a digital input: 0–7 standard, 8–15 configurable, 16–17 tool
    {"command": "input", "analog": n, "value": …}   sets an analogue input in V or A: 0–1 standard, 2–3 tool
    {"command": "surface", "point": [3], "normal": [3], "stiffness": N/m}  a spring that the TCP can touch; 0: none
    {"command": "surroundings", "file": path}       reads the arm's surroundings from a file (see `surroundings`)
"""

import json
import math
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.faults import FaultError, Links, number, prepare, vector
from hardware_sim.controller.force import SpringSurface
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.signals import Inputs
from hardware_sim.controller.sockets import LineConnection

PORT = 30200


class ControlConnection(LineConnection):
    """One client of the control port."""

    def __init__(self, stream: socket.socket, controller: Controller, links: Links) -> None:
        super().__init__(stream)
        self._controller = controller
        self._links = links

    def line(self, text: str) -> None:
        try:
            reply = self._answer(json.loads(text))
        except (FaultError, ValueError, RecursionError, OSError) as error:
            reply = {"ok": False, "error": str(error)}
        self.send((json.dumps(reply, allow_nan=False) + "\n").encode())

    def _answer(self, request: Any) -> dict[str, Any]:
        if not isinstance(request, dict):
            raise FaultError("a request is a JSON object")
        name = str(request.get("command"))
        command = _COMMANDS.get(name)
        if command is None:
            raise FaultError(f"command must be one of {', '.join(_COMMANDS)}, not {request.get('command')!r}")
        if name in _TAKES:
            _require_known(request, name, _TAKES[name])
        return {"ok": True, **(command(self._controller, self._links, request) or {})}


def _require_known(request: dict[str, Any], what: str, takes: Sequence[str]) -> None:
    """Raises FaultError for a field that the command does not take."""
    if unknown := request.keys() - {"command", *takes}:
        raise FaultError(f"{what} takes {', '.join(takes) or 'no fields'}, not {', '.join(sorted(unknown))}")


def _set_input(inputs: Inputs, request: dict[str, Any]) -> None:
    """Sets a digital or an analogue input. Raises FaultError."""
    kind = next((kind for kind in _INPUTS if kind in request), None)
    if kind is None:
        raise FaultError("input takes digital and level, or analog and value")
    _require_known(request, f"{kind} input", _INPUTS[kind])
    if kind == "digital":
        level = request.get("level")
        if not isinstance(level, bool):
            raise FaultError(f"level must be true or false, not {level!r}")
        inputs.set_level(int(number(request, "digital", 0, 17)), level)
    else:
        inputs.analog[int(number(request, "analog", 0, 3))] = number(request, "value", 0.0, 30.0)


def _set_surface(controller: Controller, request: dict[str, Any]) -> None:
    """Places a spring surface that the tool can touch, or removes it. Raises FaultError."""
    stiffness = number(request, "stiffness", 0.0, 20_000.0)
    surface = None
    if stiffness > 0.0:
        x, y, z = vector(request, "point", 3, 10.0)
        nx, ny, nz = vector(request, "normal", 3, 1.0)
        length = math.hypot(nx, ny, nz)
        if length < 0.1:
            raise FaultError("normal must have a length")
        surface = SpringSurface((x, y, z), (nx / length, ny / length, nz / length), stiffness)
    controller.arm.touch(surface)
    controller.tool_changed()


def _surround(controller: Controller, request: dict[str, Any]) -> None:
    file = request.get("file")
    if not isinstance(file, str):
        raise FaultError(f"file must be a path, not {file!r}")
    controller.collisions.surround(Path(file))


def _collisions(controller: Controller) -> dict[str, Any]:
    collisions = controller.collisions
    return {"count": collisions.count, "collisions": [asdict(c) for c in collisions.records]}


def state(controller: Controller) -> dict[str, Any]:
    """True state: the arm (m, rad, base frame), its outputs and their age, all modes and all disturbances."""
    arm, outputs, safety = controller.arm, controller.outputs, controller.safety
    joints = arm.true_joints
    tool = poses.compose(kinematics.forward(arm.model, joints), arm.flange_from_tool)
    now = time.monotonic()
    last = controller.collisions.records[-1] if controller.collisions.records else None
    return {
        "timestamp": controller.timestamp,
        "joints": joints,
        "joint_speeds": arm.speeds,
        "base_from_tool": poses.matrix(tool),
        "digital_outputs": outputs.levels,
        "output_age_s": [max(0.0, now - at) for at in outputs.changed_at],
        "analog_outputs": [outputs.analog(0), outputs.analog(1)],
        "payload": [arm.payload, *arm.payload_center],
        "tool_force": list(arm.tool_force),
        "digital_inputs": controller.inputs.levels,
        "analog_inputs": controller.inputs.analog,
        "tool_voltage": outputs.tool_voltage,
        "speed_factor": controller.speed_factor,
        "speed_slider": controller.slider,
        "robot_mode": int(controller.safety.robot_mode),
        "safety_mode": int(controller.safety.safety_mode),
        "runtime_state": int(controller.runtime_state),
        "program_running": controller.runtime_state is RuntimeState.PLAYING,
        "program": controller.program_name,
        "remote_control": safety.remote_control,
        "popup": safety.popup,
        "safety_popup": safety.safety_popup,
        "moves_started": arm.moves_started,
        "model": arm.model.name,
        "calibration_seed": arm.model.calibration_seed,
        "calibration_error_m": arm.model.calibration_error_m,
        "collisions": controller.collisions.count,
        "last_collision": None if last is None else asdict(last),
        "touching": controller.collisions.touching,
        "disturbances": asdict(controller.disturbances),
    }


_COMMANDS: dict[str, Callable[[Controller, Links, dict[str, Any]], dict[str, Any] | None]] = {
    "state": lambda c, _, request: state(c),
    "fault": prepare,
    "input": lambda c, _, request: _set_input(c.inputs, request),
    "surface": lambda c, _, request: _set_surface(c, request),
    "collisions": lambda c, _, request: _collisions(c),
    "log": lambda c, _, request: {"messages": list(c.messages)},
    "surroundings": lambda c, _, request: _surround(c, request),
}

_TAKES: dict[str, tuple[str, ...]] = {
    "state": (), "collisions": (), "log": (), "surface": ("point", "normal", "stiffness"), "surroundings": ("file",),
}  # fmt: skip
"""Fields of each command. `fault` and `input`, whose fields depend on the kind, check theirs themselves."""

_INPUTS = {"digital": ("digital", "level"), "analog": ("analog", "value")}
"""Fields of `input`, by the kind of input."""
