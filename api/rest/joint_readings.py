"""Joint readings for event streams: the arm's joint angles, several times a second, for drawings.

They are transient. A reading is useless once there is a newer one, so readings are not journalled and have no id, and
neither `Last-Event-ID` nor the replay of journalled events is affected. Each stream takes the newest reading when it is
ready to send, so a slow reader gets fewer of them. The text is made once a period for all streams, from the reading
that the driver keeps in shared memory, without a lock, a thread or a request to a device.
"""

import time
from datetime import UTC, datetime

from pydantic import Field

from acquisition.devices import Arm
from acquisition.models.base import Joints, as_joints
from acquisition.runner.loop import AT_REST_RAD_S
from api.rest.schemas import Resource

EVENT_TYPE = "arm.joints"
"""Type of these events in the stream."""

PERIOD_S = 0.125
"""Time between two readings of a stream, s. A drawing updated at 8 Hz looks continuous."""


class JointReadingResource(Resource):
    """One reading of the arm's joints: `data` of the transient event `arm.joints`, which has no id."""

    connected: bool = Field(description="Whether the arm's controller is sending; else the values are its last ones")
    joints: Joints | None = Field(description="Joint angles from the base on, rad; null before the first reading")
    moving: bool | None = Field(description="Whether a joint is faster than 0.01 rad/s; null when not connected")
    age_s: float | None = Field(description="Time since the controller's values arrived, s; null before the first one")
    at: datetime = Field(description="When this event was made, UTC")


class JointReadings:
    """The newest joint reading of an arm as text of an event stream; lives on the event loop."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._text = ""
        self._made_at = -PERIOD_S

    def message(self) -> str:
        """Returns the newest reading, at most `PERIOD_S` / 2 old, as one event."""
        now = time.monotonic()
        if now - self._made_at >= PERIOD_S / 2:
            self._text = f"event: {EVENT_TYPE}\ndata: {self._resource(now).model_dump_json()}\n\n"
            self._made_at = now
        return self._text

    def _resource(self, now: float) -> JointReadingResource:
        reading = self._arm.reading
        known = reading.received_at > 0
        fastest = max(map(abs, reading.joint_speeds), default=0.0)
        return JointReadingResource(
            connected=reading.connected,
            joints=as_joints(reading.joints) if known else None,
            moving=fastest >= AT_REST_RAD_S if reading.connected else None,
            age_s=round(now - reading.received_at, 4) if known else None,
            at=datetime.now(UTC),
        )
