"""Record of every tick on disk, so that an independent grader can replay the arm's motion.

Format: the magic `LPTICKS1`, then rows of 88 bytes, little-endian: float64 time stamp (the controller's, s); 6 float64
true joints (rad); 6 float32 true TCP pose (x, y, z in m, rotation vector in rad; base frame); uint32 digital outputs
(bits 0–7 standard, 8–15 configurable, 16–17 tool); uint8 safety mode, robot mode, runtime state (the numbers of
`modes`); uint8 1 while the arm touches something. Every tick has a row (44 kB a second), also at rest, because the time
at rest is part of the record. With a speed factor above 1 a tick may have several rows, at most 8 ms of motion apart.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.robot import Robot

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    FloatArray = npt.NDArray[np.float64]
    IntArray = npt.NDArray[np.int64]

MAGIC = b"LPTICKS1"
_TIME = struct.Struct("<d")
_STATES = ("safety_mode", "robot_mode", "runtime_state", "touching")
_REST = struct.Struct("<6d6fI4B")


class Recorder:
    """Appends rows to a file."""

    def __init__(self, path: Path) -> None:
        """Raises OSError."""
        # Unbuffered: 500 small writes a second are cheap, and a killed process loses nothing.
        self._file = path.open("ab", buffering=0)
        if self._file.tell() == 0:
            self._file.write(MAGIC)
        self._joints: list[float] = []
        self._tool: list[float] = []
        self._pose: list[float] = []

    def __call__(self, robot: Robot, timestamp: float) -> None:
        """Writes a row of the robot's state."""
        arm = robot.arm
        joints = arm.true_joints
        if joints != self._joints or arm.tcp != self._tool:
            self._joints, self._tool = joints, arm.tcp
            base_from_flange = kinematics.forward(arm.model, joints)
            self._pose = list(poses.to_ur(poses.compose(base_from_flange, arm.flange_from_tool)))
        row = _REST.pack(
            *joints,
            *self._pose,
            robot.outputs.levels,
            robot.safety.safety_mode,
            robot.safety.robot_mode,
            robot.runtime_state,
            robot.collisions.touching is not None,
        )
        self._file.write(_TIME.pack(timestamp) + row)

    def close(self) -> None:
        self._file.close()


@dataclass(frozen=True)
class Trace:
    """A record read back, N rows: see the module's docstring for units."""

    times: "FloatArray"  # (N,)
    joints: "FloatArray"  # (N, 6)
    tcp: "FloatArray"  # (N, 6)
    outputs: "IntArray"  # (N,)
    safety_mode: "IntArray"  # (N,)
    robot_mode: "IntArray"  # (N,)
    runtime_state: "IntArray"  # (N,)
    touching: "IntArray"  # (N,) 0 or 1


def read_trace(path: Path) -> Trace:
    """Reads a record without a last row cut off by a kill. Raises OSError, and ValueError if it is no record."""
    import numpy as np  # noqa: PLC0415 - the controller itself does without

    data = path.read_bytes()
    if data[: len(MAGIC)] != MAGIC:
        raise ValueError(f"{path} is not a record of ticks")
    layout = np.dtype(
        [("time", "<f8"), ("joints", "<f8", 6), ("tcp", "<f4", 6), ("outputs", "<u4")] + [(n, "u1") for n in _STATES]
    )
    rows = np.frombuffer(data, layout, (len(data) - len(MAGIC)) // layout.itemsize, len(MAGIC))
    integers = {name: rows[name].astype(np.int64) for name in ("outputs", *_STATES)}
    return Trace(rows["time"].copy(), rows["joints"].copy(), rows["tcp"].astype(float), **integers)
