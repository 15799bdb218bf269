"""Programs run in a controller without sockets, and what its arm did meanwhile."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hardware_sim.controller import kinematics
from hardware_sim.controller.calibration import calibrated
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RuntimeState

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]
TICK = 0.002


@dataclass(frozen=True)
class Record:
    """Joints (N, 6) after each tick, and the controller at the end."""

    joints: np.ndarray
    controller: Controller

    @property
    def speeds(self) -> np.ndarray:
        """Joint speeds (N−1, 6) in rad/s, by differences."""
        return np.diff(self.joints, axis=0) / TICK

    @property
    def accelerations(self) -> np.ndarray:
        """Joint accelerations (N−2, 6) in rad/s², by differences."""
        return np.diff(self.joints, n=2, axis=0) / TICK**2

    @property
    def tools(self) -> np.ndarray:
        """Positions (N, 3) of the flange, m."""
        model = self.controller.arm.model
        frames = (kinematics.forward(model, joints) for joints in self.joints.tolist())
        return np.array([(f[3], f[7], f[11]) for f in frames])

    @property
    def seconds(self) -> float:
        """Time for which the arm moved, s."""
        moving = np.flatnonzero(np.abs(self.speeds).max(axis=1) > 0)
        return 0.0 if len(moving) == 0 else float(moving[-1] - moving[0] + 1) * TICK

    def message(self, part: str) -> str:
        """The last message that holds `part`; empty where none does."""
        return next((m for m in reversed(self.controller.messages) if part in m), "")


def run(
    lines: str,
    seconds: float = 60.0,
    *,
    model: str = "ur5e",
    home: Sequence[float] = HOME,
    speed_factor: float = 1.0,
    calibration_seed: int | None = None,
) -> Record:
    """Runs the lines of a program until it has ended and the arm stands, for `seconds` at the most."""
    arm = calibrated(MODELS[model], calibration_seed)
    controller = Controller(arm, home, now=0.0, speed_factor=speed_factor)
    controller.load(f"def f():\n{lines}\nend\n")
    samples = [controller.arm.joints]
    for tick in range(round(seconds / TICK)):
        controller.tick(tick * TICK)
        samples.append(controller.arm.joints)
        if controller.runtime_state is RuntimeState.STOPPED and not controller.arm.moving:
            break
    return Record(np.array(samples), controller)
