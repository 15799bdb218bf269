"""`lightpose calibrate camera | hand-eye | response | check --address …`: follows a service's session to its end.

The service moves the arm, so a person has to state that the board is on its flange: nothing starts without `--mounted`.
"""

from typing import Any

from rich.console import Console

from acquisition.models.calibration_recipe import AnyRecipe, CheckRecipe, tool_of
from acquisition.models.calibration_result import USE_IT, CalibrationSummary
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import State
from api import Client
from api.rest.schemas import SessionResource


def calibrate(address: str, recipe: AnyRecipe, *, mounted: bool, activate: bool) -> dict[str, Any]:
    """Runs a calibration session and, with `activate`, puts its result into use.

    `mounted` states that a person has put the board on the flange. Raises RigError rig.other_tool without it, and with
    the session's reason if it does not complete; ProblemError if the service refuses.
    """
    console = Console(stderr=True, markup=False)
    with Client(address) as client:
        if tool_of(recipe) == "board" and client.rig().tool != "board":
            if not mounted:
                raise RigError(
                    ErrorCode.RIG_OTHER_TOOL, "Mount the calibration board on the flange, then say so with --mounted"
                )
            client.state_tool("board")
        created = client.create(recipe)
        console.print(f"session {created.id}: POST {address}/v1/rig/stop stops it at any time")
        client.start(created.id)
        done = client.wait(created.id)
        found = used_from_now_on(completed(done)) if activate else completed(done)
        for sentence in sentences(found):
            console.print(sentence)
        console.print(f"report: {address.rstrip('/')}{report_path(client, done.id)}")
        if activate:
            client.activate_calibration(done.id)
            console.print(f"calibration {done.id} is in use")
        if isinstance(recipe, CheckRecipe):
            return {"session": done.id, **found.model_dump(mode="json")}
        return {"calibration": done.id, "active": activate, **found.model_dump(mode="json")}


def completed(session: SessionResource) -> CalibrationSummary:
    """Returns a session's calibration summary. Raises RigError if it has not completed: with its reason, or
    session.stopped."""
    if session.state is State.COMPLETED and session.estimate is not None and session.estimate.estimated:
        return session.estimate
    reason = session.reason
    if reason is None and session.state is State.STOPPED:
        raise RigError(ErrorCode.SESSION_STOPPED, f"Session {session.id} is stopped")
    code = ErrorCode.CALIBRATION_INFEASIBLE if reason is None else reason.code
    why = "no estimate" if reason is None else reason.detail
    raise RigError(code, f"Session {session.id} is {session.state}: {why}")


def used_from_now_on(found: CalibrationSummary) -> CalibrationSummary:
    """Returns the summary of a result that the command itself puts into use, without the advice to do so."""
    return found.model_copy(update={"advice": [sentence for sentence in found.advice if sentence != USE_IT]})


def report_path(client: Client, session_id: str) -> str:
    """Returns the path, at the service's address, of the report of a session's newest estimate."""
    return f"/v1/sessions/{session_id}/estimates/{client.estimates(session_id)[-1].number}/report.html"


def target_at_hand(address: str) -> str:
    """Returns the target for a check: the board if it is on the flange, else the plane."""
    with Client(address) as client:
        return "board" if client.rig().tool == "board" else "plane"


def sentences(found: CalibrationSummary) -> list[str]:
    """Formats the result of a calibration session and the advice for people."""
    said: list[str] = []
    if found.focal_px is not None and found.projection_sigma_px is not None:
        said.append(f"focal length {found.focal_px:.1f} px; projection uncertainty {found.projection_sigma_px:.3f} px")
    if found.position_sigma_mm is not None:
        what = "lamp" if found.rotation_sigma_deg is None else "camera"
        turned = "" if found.rotation_sigma_deg is None else f" and {found.rotation_sigma_deg:.3f}°"
        said.append(f"{what} known to {found.position_sigma_mm:.2f} mm{turned}")
    if found.verified_deg is not None:
        said.append(f"verified on the held-out placing: mean error of the normals {found.verified_deg:.2f}°")
    if found.gain_e_per_dn is not None:
        said.append(
            f"{found.gain_e_per_dn:.3f} electrons per value, read noise {found.read_noise_e:.2f}, full well "
            f"{found.full_well_e:.0f} electrons; {found.defective_pixels} defective pixels"
        )
    return [*said, *found.advice]
