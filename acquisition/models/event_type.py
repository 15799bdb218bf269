"""Types of the journal's events."""

from typing import Literal

EventType = Literal[
    "arm.sent", "answer.chosen", "calibration.activated", "calibration.checked", "calibration.made", "camera.fault",
    "device.changed", "estimate.ready", "normals.ready", "plan.ready", "plan.reviewed", "queue.changed", "region.drawn",
    "resolve.accepted", "resolve.failed", "rig.jogged", "rig.parked", "safety.changed", "session.archive_failed",
    "session.archived", "session.created", "session.deleted", "session.described", "session.progress", "session.stage",
    "session.state", "shot.captured", "shot.retaken", "shots.discarded", "tool.mounted", "waypoints.ready",
]  # fmt: skip
"""All that this release writes; docs/reference/rest.md says what each means. A later release may have more."""
