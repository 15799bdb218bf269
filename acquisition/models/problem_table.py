"""The table of problem codes: HTTP status, title and remedy of each.

It is the only definition of a code's meaning. The HTTP problem pages, the session's `reason` and the runbook are
generated from it.
"""

from dataclasses import dataclass
from typing import Any

from acquisition.models.errors import ErrorCode


@dataclass(frozen=True)
class Problem:
    """HTTP status, title and remedy of a problem code."""

    status: int
    title: str
    remedy: str


PROBLEMS: dict[ErrorCode, Problem] = {
    ErrorCode.REQUEST_INVALID: Problem(
        422,
        "The request is invalid",
        "Correct what the detail says and try again; `errors`, if given, names the fields.",
    ),
    ErrorCode.REQUEST_NOT_FOUND: Problem(
        404, "No resource exists at this address", "Follow the links of a session, or see /docs for the routes."
    ),
    ErrorCode.REQUEST_METHOD_NOT_ALLOWED: Problem(
        405, "This address does not support that method", "Use one of the methods in the Allow header."
    ),
    ErrorCode.REQUEST_FOREIGN: Problem(
        403,
        "The request comes from a foreign page or names a foreign host",
        "Call the service by its own address, or set what the detail names to allow further hosts, pages or proxies.",
    ),
    ErrorCode.REQUEST_UNAUTHENTICATED: Problem(
        401,
        "The request carries no valid key",
        "Send `Authorization: Bearer <key>`; `lightpose keys add` makes one. Pages use a ticket of POST /v1/tickets.",
    ),
    ErrorCode.REQUEST_FORBIDDEN: Problem(
        403, "The key's role does not allow this", "Use a key of the role in `needed`; `lightpose keys add` makes one."
    ),
    ErrorCode.REQUEST_TOO_MANY_FAILURES: Problem(
        429, "Too many failed authentications", "Wait for `retry_after_s` seconds; then send a valid key."
    ),
    ErrorCode.REQUEST_TOO_MANY_STREAMS: Problem(
        429,
        "The key has too many open streams",
        "Close streams that nobody reads, then try again after `retry_after_s`.",
    ),
    ErrorCode.REQUEST_TOO_LARGE: Problem(413, "The request body is too large", "Send a smaller body."),
    ErrorCode.REQUEST_MEDIA_TYPE: Problem(
        415, "The request body has the wrong media type", "Send the body with the Content-Type that the detail names."
    ),
    ErrorCode.REQUEST_TIMEOUT: Problem(
        408, "The request did not arrive in time", "Send the full request at once, over a faster connection."
    ),
    # Not 408: browsers take it as the end of an idle connection and send the request again.
    ErrorCode.REQUEST_EXPIRED: Problem(
        409,
        "The request arrived after its Valid-Until time",
        "Nothing was done. Look at the cell and at the present state, then ask again with a later Valid-Until.",
    ),
    ErrorCode.CONFIG_INVALID: Problem(
        500,
        "A configuration file or a setting is invalid",
        "Do what the detail says, or correct the file or setting that it names; `lightpose check` tests the files.",
    ),
    ErrorCode.SESSION_NOT_FOUND: Problem(404, "There is no such session", "List the sessions with GET /v1/sessions."),
    ErrorCode.SESSION_ACTION_NOT_ALLOWED: Problem(
        409,
        "The session's state does not allow this action",
        "If `allowed` names actions, choose one of them; if not, the session cannot do this: the detail says why.",
    ),
    ErrorCode.SESSION_STEP_FAILED: Problem(
        500, "A step of the session failed", "Read the detail; the frames captured so far are kept."
    ),
    ErrorCode.SESSION_STOPPED: Problem(
        409,
        "Somebody stopped the session",
        "Look at the cell and find out who stopped it (`by` in its events `session.state`); then start a new session. "
        "Its images are kept: three or more can be solved.",
    ),
    ErrorCode.RESULT_NOT_READY: Problem(
        409, "The result is not ready yet", "Wait for the event `normals.ready`, then ask again."
    ),
    ErrorCode.RESULT_CANCELLED: Problem(
        410, "The solve of this result was cancelled", "Ask for it again with POST …/results, if it is still wanted."
    ),
    ErrorCode.RIG_BUSY: Problem(
        409,
        "The rig is in use",
        "If `holder` names a session, wait until it has ended, or stop it; if not, do what the detail says.",
    ),
    ErrorCode.RIG_NOT_READY: Problem(
        503, "The rig is not ready", "See `reasons` in GET /v1/rig, correct them, and start again."
    ),
    ErrorCode.RIG_CHANGED: Problem(
        409,
        "The rig's configuration changed since the session began",
        "Restore the cell file and calibration, or start a new session.",
    ),
    ErrorCode.RIG_OTHER_TOOL: Problem(
        409,
        "The tool on the flange is not the one that the session needs",
        "Mount the tool named in `needed`, state it with PUT /v1/rig/tool, then start.",
    ),
    ErrorCode.ARM_UNREACHABLE: Problem(
        503, "The arm does not respond at its address", "Check power, cable and `arm.address` in the cell file."
    ),
    ErrorCode.ARM_IN_USE: Problem(
        503, "Another program controls the arm", "End the other program or RTDE client; then connect again."
    ),
    ErrorCode.ARM_PREFLIGHT: Problem(
        503, "The arm does not match the cell file", "Correct each item of `findings`; nothing has moved."
    ),
    ErrorCode.ARM_PROTECTIVE_STOP: Problem(
        423,
        "The arm is in a protective stop",
        "Inspect the cell, clear the cause, unlock at the pendant, acknowledge, then resume.",
    ),
    ErrorCode.ARM_EMERGENCY_STOP: Problem(
        423,
        "An emergency stop is pressed",
        "Clear the danger, release the button, power on at the pendant, acknowledge.",
    ),
    ErrorCode.ARM_NOT_READY: Problem(
        503,
        "The arm is not ready to move",
        "If it is off, power it on and release the brakes at the pendant; then resume, which connects again.",
    ),
    ErrorCode.ARM_MOVE_FAILED: Problem(
        503, "A move did not reach its target", "Inspect the cell; resume plans again from the present configuration."
    ),
    ErrorCode.ARM_ELSEWHERE: Problem(
        409,
        "The arm is not where this session left it",
        "Inspect the cell; if the arm may move from its present position, resume with `from_here`: true.",
    ),
    ErrorCode.ARM_JOG_ENDED: Problem(
        409, "The motion of this press has ended", "Release the button and press it again, with a new `hold`."
    ),
    ErrorCode.SAFETY_SOFTWARE_STOP: Problem(
        423,
        "Somebody has stopped the cell with the software stop",
        "Inspect the cell, then POST /v1/rig/safety/acknowledgement.",
    ),
    ErrorCode.SAFETY_NOT_ACKNOWLEDGED: Problem(
        423,
        "A safety stop has not been acknowledged",
        "Inspect the cell, then POST /v1/rig/safety/acknowledgement.",
    ),
    ErrorCode.SAFETY_STILL_FAULTED: Problem(
        409, "The controller still reports a safety stop", "Clear it at the pendant first, then acknowledge."
    ),
    ErrorCode.SAFETY_RECOVERY_FORBIDDEN: Problem(
        403,
        "This cell is recovered at the pendant only",
        "Recover the arm at the pendant; `arm.remote_recovery` in the cell file would allow it from here.",
    ),
    ErrorCode.SAFETY_RECOVERY_REFUSED: Problem(
        409,
        "The controller refused the recovery",
        "See the detail for the controller's answer, or recover at the pendant.",
    ),
    ErrorCode.DEVICE_DISCONNECTED: Problem(
        503, "The connection to a device is lost", "Check the cable and the device, acknowledge; then resume."
    ),
    ErrorCode.DRIVER_LOST: Problem(
        503,
        "The arm's driver process ended or does not respond",
        "Inspect the cell, acknowledge; then resume, which restarts it.",
    ),
    ErrorCode.LAMP_NOT_CONFIRMED: Problem(
        503, "The lamp's output did not switch", "Check the lamp's output number and wiring; then resume."
    ),
    ErrorCode.COMPUTE_LOST: Problem(
        503,
        "The compute process ended unexpectedly twice during the same task",
        "Most often memory ran out (see the kernel's log): end other programs or add memory; then resume, which "
        "continues this task, or send the request again.",
    ),
    ErrorCode.CAMERA_UNREACHABLE: Problem(
        503,
        "The camera does not respond at its address",
        "Check power, cable and the `camera` section of the cell file.",
    ),
    ErrorCode.CAMERA_TIMEOUT: Problem(503, "The camera sent no frame in time", "Check the camera; then resume."),
    ErrorCode.CAPTURE_FRAME_REJECTED: Problem(
        503,
        "A frame failed its checks after all retakes",
        "See the detail; correct lamp, exposure or scene, then resume.",
    ),
    ErrorCode.PLAN_INFEASIBLE: Problem(
        422,
        "No such set of lights is feasible in this cell",
        "Request fewer lights, or extend the reach (see the detail).",
    ),
    ErrorCode.PLAN_TO_REVIEW: Problem(
        409,
        "The planned lights wait for review",
        "Review the pass; resume captures its lights, PUT /v1/sessions/{id}/passes/{n}/plan replaces them.",
    ),
    ErrorCode.QUEUE_OBJECT_TO_PLACE: Problem(
        409,
        "The queue waits for the next object",
        "Put the named object in its place, leave the cell, then resume the queue (POST /v1/queue/actions).",
    ),
    ErrorCode.QUEUE_ENTRY_BEGUN: Problem(
        409, "The entry's session has begun", "Stop its session, or let it end; the entry can be removed then."
    ),
    ErrorCode.QUEUE_HALTED: Problem(
        409, "The queue was stopped with the cell", "Inspect the cell, then resume the queue (POST /v1/queue/actions)."
    ),
    ErrorCode.QUEUE_SESSION_ENDED: Problem(
        409,
        "A session of the queue did not complete",
        "See the session; add its object again if you want it, then resume the queue (POST /v1/queue/actions).",
    ),
    ErrorCode.WAYPOINTS_UNREACHABLE: Problem(
        422, "A light is unreachable", "Move or omit the lights named in `lights`; GET /v1/rig/reach shows the reasons."
    ),
    ErrorCode.WAYPOINTS_COLLISION: Problem(
        422, "There is no collision-free path", "Move the arm clear by hand, or omit the lights named in `lights`."
    ),
    ErrorCode.CALIBRATION_INFEASIBLE: Problem(
        422,
        "These images do not determine the calibration",
        "Do what the detail says, usually take more images, tilted to different sides; nothing was overwritten.",
    ),
    ErrorCode.CALIBRATION_TARGET_NOT_SEEN: Problem(
        503,
        "The calibration target is not seen in the image",
        "Look at the image: mount, light or expose it as the detail says, then resume; no image so far is lost.",
    ),
    ErrorCode.CALIBRATION_PLACE_TARGET: Problem(
        409,
        "The session waits for another calibration target",
        "Put the target into the object's place as the detail says, leave the cell, then resume.",
    ),
    ErrorCode.CALIBRATION_BOARD_WRONG: Problem(
        422,
        "The calibration board is not the one that is described",
        "Measure the squares and correct the board's description, then begin a new session; nothing was overwritten.",
    ),
    ErrorCode.CALIBRATION_NOT_FOUND: Problem(
        404, "There is no such calibration", "List the calibrations with GET /v1/rig/calibrations."
    ),
    ErrorCode.CALIBRATION_DOES_NOT_FIT: Problem(
        409,
        "The calibration was made for another rig",
        "Choose one of this camera and arm (GET /v1/rig/calibrations), or calibrate this one.",
    ),
    ErrorCode.NORMALS_INFEASIBLE: Problem(
        422, "Normals cannot be solved from these images", "See the detail: at least three usable lights are needed."
    ),
    ErrorCode.FOLDER_INVALID: Problem(
        422, "A capture folder cannot be read", "Correct the file named in the detail; nothing has been written."
    ),
    ErrorCode.SCENE_MOVED: Problem(
        409,
        "The object or the camera has moved",
        "Put it back and resume, or start a new session. An object that moved in the first pass may stay: all images "
        "are captured again.",
    ),
    ErrorCode.STORE_DISK_FULL: Problem(
        507, "The disk is full", "Free space in the data folder, then resume; no announced frame is lost."
    ),
    ErrorCode.STORE_UNWRITABLE: Problem(
        503,
        "The data folder cannot be written",
        "Check disk and permissions of the file that the detail names, or end the program that holds rig.db open; then "
        "resume: nothing is lost.",
    ),
    ErrorCode.STORE_LOCKED: Problem(
        503, "Another service uses this data folder", "Stop the other service, or choose another data folder."
    ),
    ErrorCode.STORE_CORRUPT: Problem(
        500,
        "A stored file is missing or damaged",
        "Restore what the detail names from a backup; a newer release's database needs that release.",
    ),
    ErrorCode.ARCHIVE_ADDRESS_INVALID: Problem(
        422,
        "The archive's address cannot be used",
        "Give the archive's folder, mounted, or an address such as s3://bucket/archive; `archive create` begins one.",
    ),
    ErrorCode.ARCHIVE_UNREACHABLE: Problem(
        503,
        "The archive or its catalogue does not answer",
        "Check address, network and rights (AWS_… or PG… in the environment); nothing is lost, call again.",
    ),
    ErrorCode.ARCHIVE_CATALOGUE_NEWER: Problem(
        409, "The archive's catalogue is of a newer release", "Update lightpose here; nothing was changed."
    ),
    ErrorCode.ARCHIVE_QUERY_INVALID: Problem(
        422, "The condition cannot be read", "Correct it as the detail says; docs/how-to/archive.md has the grammar."
    ),
    ErrorCode.ARCHIVE_NOT_FOUND: Problem(
        404, "The archive has no such session", "List its sessions with `lightpose archive list`."
    ),
    ErrorCode.ARCHIVE_DAMAGED: Problem(
        500,
        "A file of the archive is missing or damaged",
        "Push the session again from where it still is, or restore the file from a backup of the archive.",
    ),
    ErrorCode.ARCHIVE_NO_SCHEDULER: Problem(
        503, "No Dask scheduler answers", "Start one (`dask scheduler`), correct the address, or use --local N."
    ),
    ErrorCode.SERVICE_RESTARTED: Problem(
        503, "The service ended during a session", "Inspect the cell, then resume; nothing moves before."
    ),
    ErrorCode.SERVICE_OVERLOADED: Problem(
        503,
        "The service has as many connections, requests or streams as it can hold",
        "Try again after `retry_after_s` seconds; find out who holds them. A stop is still answered.",
    ),
    ErrorCode.SERVICE_UNREACHABLE: Problem(
        503,
        "No service answers at this address",
        "Start it there with `lightpose serve`, or correct the address. A session that has begun there goes on.",
    ),
    ErrorCode.SERVICE_FAULT: Problem(
        500, "Internal error of the service", "Keep the log and report it; the session's data are safe."
    ),
}


def problem(code: ErrorCode, detail: str, **context: Any) -> dict[str, Any]:
    """Returns the problem object for journal and status: the table's entry with the detail of this case."""
    entry, sentence = PROBLEMS[code], detail.removesuffix(".")
    return {"code": str(code), "title": entry.title, "detail": sentence, "remedy": entry.remedy, **context}
