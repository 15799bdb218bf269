"""Status of a simulated cell as JSON lines: one at each change, and one for each interval without a change.

Fields: `at` (the controller's time stamp, s), `arm` (`stands` or `moves`), `robot_mode`, `safety_mode`, `program` (its
state and name), `outputs` (bits), `lamp` (`ok`, `dead` or the share of its light), `collisions` (how many so far),
`last_collision` (both parts, when, joints) and, only in lines for the interval, `joints` (rad).
"""

import json
from typing import Any

from hardware_sim.controller.modes import RobotMode, RuntimeState, SafetyMode

INTERVAL_S = 5.0


class StatusLines:
    """Turns states of the control port into lines."""

    def __init__(self) -> None:
        self._last: dict[str, Any] | None = None
        self._printed_at = 0.0

    def line(self, state: dict[str, Any], now: float) -> str | None:
        """The line to print for a state at `now` (s, any clock), or None while nothing changes within the interval."""
        status = summary(state)
        changed = status != self._last
        if not changed and now - self._printed_at < INTERVAL_S:
            return None
        self._last, self._printed_at = status, now
        fields = {"at": round(state["timestamp"], 3), **status}
        if not changed:
            fields["joints"] = [round(q, 6) for q in state["joints"]]
        return json.dumps(fields)


def summary(state: dict[str, Any]) -> dict[str, Any]:
    """The fields whose change makes a line."""
    fraction = state["disturbances"]["lamp_fraction"]
    return {
        "arm": "moves" if any(state["joint_speeds"]) else "stands",
        "robot_mode": RobotMode(state["robot_mode"]).name,
        "safety_mode": SafetyMode(state["safety_mode"]).name,
        "program": f"{RuntimeState(state['runtime_state']).name} {state['program']}".strip(),
        "outputs": state["digital_outputs"],
        "lamp": "ok" if fraction == 1.0 else "dead" if fraction == 0.0 else fraction,
        "collisions": state["collisions"],
        "last_collision": state["last_collision"],
    }
