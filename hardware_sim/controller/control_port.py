"""The simulator's own port (30200): the truth about the arm, and faults on demand.

One JSON object per line in, one per line out. No real controller has it; only the simulated world and tests use it.
Requests: `{"command": "state"}`, `{"command": "fault", "kind": …, "at_s": …, …}`, `{"command": "log"}`. Replies carry
`"ok"`, and `"error"` where it is false.
"""

import json
import socket
import time
from typing import Any

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.faults import FaultError, Links, prepare
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.sockets import LineConnection

PORT = 30200


class ControlConnection(LineConnection):
    """One client of the control port."""

    def __init__(self, stream: socket.socket, controller: Controller, links: Links) -> None:
        super().__init__(stream)
        self._controller = controller
        self._links = links

    def line(self, text: str) -> None:
        """Answers one request."""
        try:
            reply = self._answer(json.loads(text))
        except (FaultError, ValueError, RecursionError) as error:
            reply = {"ok": False, "error": str(error)}
        self.send((json.dumps(reply, allow_nan=False) + "\n").encode())

    def _answer(self, request: Any) -> dict[str, Any]:
        if not isinstance(request, dict):
            raise FaultError("a request is a JSON object")
        command = request.get("command")
        if command == "state":
            return {"ok": True, **state(self._controller)}
        if command == "log":
            return {"ok": True, "messages": list(self._controller.messages)}
        if command == "fault":
            prepare(self._controller, self._links, request)
            return {"ok": True}
        raise FaultError(f"command must be state, fault or log, not {command!r}")


def state(controller: Controller) -> dict[str, Any]:
    """The truth: where the arm is, what its outputs are and since when."""
    arm, outputs = controller.arm, controller.outputs
    joints = arm.true_joints
    tool = poses.compose(kinematics.forward(arm.model, joints), arm.flange_from_tool)
    now = time.monotonic()
    return {
        "timestamp": controller.timestamp,
        "joints": joints,
        "joint_speeds": arm.speeds,
        "base_from_tool": poses.matrix(tool),
        "digital_outputs": outputs.levels,
        "output_age_s": [max(0.0, now - at) for at in outputs.changed_at],
        "analog_outputs": [outputs.analog(0), outputs.analog(1)],
        "speed_factor": controller.speed_factor,
        "speed_slider": controller.slider,
        "robot_mode": int(controller.robot_mode),
        "safety_mode": int(controller.safety_mode),
        "runtime_state": int(controller.runtime_state),
        "program_running": controller.runtime_state is RuntimeState.PLAYING,
        "remote_control": controller.remote_control,
        "moves_started": arm.moves_started,
        "model": arm.model.name,
    }
