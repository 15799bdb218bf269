"""Converts the driver's samples into readings of the arm for the service."""

from collections.abc import Sequence

from acquisition import geometry
from acquisition.devices import ArmReading, DriverPriority, TrackPoint
from acquisition.devices.ur.protocol import Link, Sample
from acquisition.process_priority import Priority

PRIORITIES: dict[Priority, DriverPriority] = {
    Priority.ORDINARY: "ordinary",
    Priority.NICENESS: "niceness",
    Priority.REAL_TIME: "real-time",
}
"""Names of the scheduling that a driver's process was granted."""

NO_READING = ArmReading(
    False, (0.0,) * 6, (0.0,) * 6, geometry.pose((0, 0, 0), (0, 0, 0)), 0.0, -1, 0, -1, False, 0.0, 0, 0.0
)
"""The value before the first connection."""

Track = list[TrackPoint]
"""Positions of the arm, oldest first."""


def reading_of(
    sample: Sample, fresh: bool, lost_reason: str, priority: DriverPriority | None, taking_control: bool
) -> ArmReading:
    """Returns the reading of a sample; `fresh` while its driver lives, else `lost_reason` gives the cause if known."""
    connected = sample.link is Link.OK and fresh
    return ArmReading(
        connected=connected,
        joints=sample.joints,
        joint_speeds=sample.joint_speeds,
        base_from_tool=geometry.pose(sample.base_from_tool[:3], sample.base_from_tool[3:]),
        timestamp=sample.timestamp,
        robot_mode=sample.robot_mode,
        safety_bits=sample.safety_bits,
        runtime_state=sample.runtime_state,
        program_running=sample.program_running and fresh,
        speed_fraction=sample.speed_fraction,
        digital_outputs=sample.digital_outputs,
        received_at=sample.received_at,
        lost="" if connected else lost_reason or sample.lost,
        driver_priority=priority,
        taking_control=taking_control,
    )


def point_of(values: Sequence[float]) -> TrackPoint:
    """Returns a point of the track from its values in the shared memory."""
    return TrackPoint(values[0], values[1], tuple(values[2:8]), geometry.pose(values[8:11], values[11:14]))
