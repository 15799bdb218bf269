"""Moving to a waypoint and exposing there: the order of arm, lamp and camera, in one place.

The lamp is switched off in every case, also when the exposure fails. The light of a frame follows from the arm's
measured pose while the frame was exposed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from acquisition.devices import ArmReading, Frame, MotionLimits, Rig, StopToken
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import ShotMotion

MAX_EXPOSURE_MOTION_RAD = 5e-4
"""Largest movement, rad, of a joint during an exposure (0.5 mm at 1 m); a larger one rejects the frame."""

FRAMES_APART = 100
"""Difference of the attempt numbers of a light's successive frames. By it a simulated cell draws new noise for each but
keeps the lamp's errors, because the arm does not move between them."""

MOST_RETURNS = 5
"""How often the camera may disappear and return during one image; beyond that its link has to be repaired."""


@dataclass(frozen=True)
class Exposed:
    """A frame and the arm's reading for it; `motion` is given if it was taken while the arm moved."""

    frame: Frame
    reading: ArmReading
    motion: ShotMotion | None = None


def follow_path(rig: Rig, path: Sequence[Sequence[float]], speeds: Sequence[float], stop: StopToken) -> None:
    """Follows a checked joint path (rad; leading-joint speeds in rad/s) and waits the settling time.

    Raises Halted, RigError arm.move_failed, and what else the arm reports.
    """
    rig.arm.move(path, motion_limits(rig.cell, speeds), stop)
    rig.clock.wait(rig.cell.arm.settle_s, stop)


def motion_limits(cell: CellConfig, speeds: Sequence[float]) -> list[MotionLimits]:
    """Returns the limits of speed and acceleration of each segment, with speeds clipped to the cell's."""
    return [
        MotionLimits(min(speed, cell.arm.max_joint_speed_rad_s), cell.arm.max_joint_acceleration_rad_s2)
        for speed in speeds
    ]


def expose(rig: Rig, exposure_s: float, attempt: int, *, lit: bool, stop: StopToken) -> Exposed:
    """Takes one frame with the lamp confirmed on (or off) and the arm at rest. If the camera disappears, waits for it
    with the lamp off, and exposes again.

    Raises Halted, RigError lamp.not_confirmed, camera.timeout, camera.unreachable, device.disconnected, and
    arm.move_failed when the arm moved meanwhile.
    """
    for _ in range(MOST_RETURNS):
        try:
            return _expose_once(rig, exposure_s, attempt, lit, stop)
        except RigError:
            if not rig.camera.is_gone:
                raise
            rig.camera.take_up(stop)
    return _expose_once(rig, exposure_s, attempt, lit, stop)


def _expose_once(rig: Rig, exposure_s: float, attempt: int, lit: bool, stop: StopToken) -> Exposed:
    if not lit:
        rig.lamp.set(False)
        return Exposed(rig.camera.expose(exposure_s, attempt, stop), rig.arm.reading)
    try:
        rig.lamp.set(True)
        rig.clock.wait(rig.cell.lamp.rise_s, stop)
        before = rig.arm.reading
        frame = rig.camera.expose(exposure_s, attempt, stop)
        reading = rig.arm.reading
    finally:
        rig.lamp.set(False)
    moved = max(abs(one - two) for one, two in zip(before.joints, reading.joints, strict=True))
    if moved > MAX_EXPOSURE_MOTION_RAD:
        raise RigError(
            ErrorCode.ARM_MOVE_FAILED,
            f"The arm moved by {moved:.4f} rad while a frame was exposed",
            moved_rad=moved,
        )
    return Exposed(frame, reading)
