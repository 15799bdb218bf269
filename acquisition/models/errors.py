"""The error type of all failures: a dotted problem code, a sentence about this case, and context for programs.

`problem_table` says what each code means and what to do about it.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError


class ErrorCode(StrEnum):
    """Stable problem codes; clients switch on these, never on sentences."""

    REQUEST_INVALID = "request.invalid"
    REQUEST_NOT_FOUND = "request.not_found"
    REQUEST_METHOD_NOT_ALLOWED = "request.method_not_allowed"
    REQUEST_FOREIGN = "request.foreign"
    REQUEST_UNAUTHENTICATED = "request.unauthenticated"
    REQUEST_FORBIDDEN = "request.forbidden"
    REQUEST_TOO_MANY_FAILURES = "request.too_many_failures"
    REQUEST_TOO_MANY_STREAMS = "request.too_many_streams"
    REQUEST_TOO_LARGE = "request.too_large"
    REQUEST_MEDIA_TYPE = "request.media_type"
    REQUEST_TIMEOUT = "request.timeout"
    REQUEST_EXPIRED = "request.expired"
    CONFIG_INVALID = "config.invalid"
    SESSION_NOT_FOUND = "session.not_found"
    SESSION_ACTION_NOT_ALLOWED = "session.action_not_allowed"
    SESSION_STEP_FAILED = "session.step_failed"
    SESSION_STOPPED = "session.stopped"
    RESULT_NOT_READY = "result.not_ready"
    RESULT_CANCELLED = "result.cancelled"
    RIG_BUSY = "rig.busy"
    RIG_NOT_READY = "rig.not_ready"
    RIG_CHANGED = "rig.changed"
    RIG_OTHER_TOOL = "rig.other_tool"
    ARM_UNREACHABLE = "arm.unreachable"
    ARM_IN_USE = "arm.in_use"
    ARM_PREFLIGHT = "arm.preflight"
    ARM_PROTECTIVE_STOP = "arm.protective_stop"
    ARM_EMERGENCY_STOP = "arm.emergency_stop"
    ARM_NOT_READY = "arm.not_ready"
    ARM_MOVE_FAILED = "arm.move_failed"
    ARM_ELSEWHERE = "arm.elsewhere"
    ARM_JOG_ENDED = "arm.jog_ended"
    SAFETY_SOFTWARE_STOP = "safety.software_stop"
    SAFETY_NOT_ACKNOWLEDGED = "safety.not_acknowledged"
    SAFETY_STILL_FAULTED = "safety.still_faulted"
    SAFETY_RECOVERY_FORBIDDEN = "safety.recovery_forbidden"
    SAFETY_RECOVERY_REFUSED = "safety.recovery_refused"
    DEVICE_DISCONNECTED = "device.disconnected"
    DRIVER_LOST = "driver.lost"
    LAMP_NOT_CONFIRMED = "lamp.not_confirmed"
    COMPUTE_LOST = "compute.lost"
    CAMERA_UNREACHABLE = "camera.unreachable"
    CAMERA_TIMEOUT = "camera.timeout"
    CAPTURE_FRAME_REJECTED = "capture.frame_rejected"
    PLAN_INFEASIBLE = "plan.infeasible"
    PLAN_TO_REVIEW = "plan.to_review"
    QUEUE_OBJECT_TO_PLACE = "queue.object_to_place"
    QUEUE_ENTRY_BEGUN = "queue.entry_begun"
    QUEUE_HALTED = "queue.halted"
    QUEUE_SESSION_ENDED = "queue.session_ended"
    WAYPOINTS_UNREACHABLE = "waypoints.unreachable"
    WAYPOINTS_COLLISION = "waypoints.collision"
    NORMALS_INFEASIBLE = "normals.infeasible"
    CALIBRATION_INFEASIBLE = "calibration.infeasible"
    CALIBRATION_TARGET_NOT_SEEN = "calibration.target_not_seen"
    CALIBRATION_PLACE_TARGET = "calibration.place_target"
    CALIBRATION_BOARD_WRONG = "calibration.board_wrong"
    CALIBRATION_NOT_FOUND = "calibration.not_found"
    CALIBRATION_DOES_NOT_FIT = "calibration.does_not_fit"
    FOLDER_INVALID = "folder.invalid"
    SCENE_MOVED = "scene.moved"
    STORE_DISK_FULL = "store.disk_full"
    STORE_UNWRITABLE = "store.unwritable"
    STORE_LOCKED = "store.locked"
    STORE_CORRUPT = "store.corrupt"
    ARCHIVE_ADDRESS_INVALID = "archive.address_invalid"
    ARCHIVE_UNREACHABLE = "archive.unreachable"
    ARCHIVE_CATALOGUE_NEWER = "archive.catalogue_newer"
    ARCHIVE_QUERY_INVALID = "archive.query_invalid"
    ARCHIVE_NOT_FOUND = "archive.not_found"
    ARCHIVE_DAMAGED = "archive.damaged"
    ARCHIVE_NO_SCHEDULER = "archive.no_scheduler"
    SERVICE_RESTARTED = "service.restarted"
    SERVICE_OVERLOADED = "service.overloaded"
    SERVICE_UNREACHABLE = "service.unreachable"
    SERVICE_FAULT = "service.fault"


NOT_WRITTEN = frozenset({ErrorCode.STORE_DISK_FULL, ErrorCode.STORE_UNWRITABLE})
"""Problems of writing the journal. An entry that must not be lost is tried again until they are solved."""


def in_words(error: Mapping[str, Any]) -> str:
    """Returns the message of one of Pydantic's errors: Pydantic puts an exception's name before our own sentences."""
    if error["type"] == "extra_forbidden":
        return "There is no such field"
    if error["type"] == "union_tag_invalid":
        return f"`kind` must be one of {error['ctx']['expected_tags']}, not '{error['ctx']['tag']}'"
    return str(error["msg"]).removeprefix("Value error, ")


def wrong_fields(error: "ValidationError") -> str:
    """Names each wrong field and what is wrong with it, in one line."""
    parts = ((".".join(map(str, item["loc"])), in_words(item)) for item in error.errors(include_url=False))
    return "; ".join(": ".join(filter(None, part)) for part in parts)


class RigError(Exception):
    """A problem with a code from the table, a sentence about this case, and `context` for programs. The sentence has no
    full stop, because further text may follow."""

    def __init__(self, code: ErrorCode, detail: str, **context: Any) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = _open(detail)
        self.context = context

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors are pickled to leave the compute and driver processes; the default would lose code and context.
        return _rebuild, (str(self.code), self.detail, self.context)

    def __str__(self) -> str:
        return f"{self.code}: {self.detail}"


def _open(sentence: str) -> str:
    return sentence.removesuffix(".")


def _rebuild(code: str, detail: str, context: dict[str, Any]) -> RigError:
    return RigError(ErrorCode(code), detail, **context)


class Halted(Exception):  # noqa: N818 - an end by request is no error
    """Raised by a device call that ended early because the stop token was set; not an error."""
