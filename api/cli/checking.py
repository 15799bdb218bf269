"""`lightpose check`: checks a cell before anything moves and prints each finding with its remedy.

It continues after a finding, so that one visit to the cell suffices: files, age of the calibration, reach and route,
arm (each setting that differs from the cell file), camera. Beside a running service the arm is in use, and the check
reports that.
"""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console

from acquisition import geometry, lamp_pose, photometry
from acquisition.capture import camera_fit
from acquisition.devices.ur import primary
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import PROBLEMS
from acquisition.models.recipe import Recipe
from acquisition.runner import jobs
from acquisition.store.folder import require_space
from acquisition.waypoints import collision
from acquisition.waypoints.reach import ReachMap
from api.rest import keys, wiring

REMEDIES = {
    ErrorCode.WAYPOINTS_COLLISION: "Correct `home`, or the bodies in its way, in the cell file, where lengths are in "
    "m; then check again.",
    ErrorCode.PLAN_INFEASIBLE: "Correct `dome`, `flange_from_tool` and the bodies in the way in the cell file, where "
    "lengths are in m; then check again.",
}
"""Remedies of errors that the cell file alone causes here, where those of the table suit a session."""


def check(cell_file: Path, *, offline: bool, data: Path | None = None) -> bool:
    """Checks a cell, and the service's data folder if given, and prints the findings; moves nothing.

    Returns True if there are none.
    """
    console = Console(highlight=False, markup=False, soft_wrap=True)
    passed: list[bool] = []
    if data is not None:
        passed.append(_passes(console, lambda: _data(console, data)))
    try:
        cell = cell_config.load(cell_file)
    except RigError as error:
        _print_finding(console, error)
        return False
    console.print(
        f"ok    cell '{cell.name}': {cell.arm.model} at {cell.arm.address}, fingerprint {cell.fingerprint[:12]}"
    )
    passed.append(_passes(console, lambda: _offline(console, cell, cell_file)))
    if not offline:
        passed.append(_passes(console, lambda: _arm(console, cell)))
        passed.append(_passes(console, lambda: _factory_calibration(console, cell)))
        passed.append(_passes(console, lambda: _camera(console, cell, cell_file)))
    return all(passed)


def _passes(console: Console, part: Callable[[], bool]) -> bool:
    """Runs a part of the check and prints a RigError as a finding. Returns True without findings."""
    try:
        return part()
    except RigError as error:
        _print_finding(console, error)
        return False


def _data(console: Console, data: Path) -> bool:
    """Checks that the data folder's keys can be read, and that there is room for a session."""
    content = keys.read(keys.path_in(data))
    if content is None:
        console.print("ok    no keys: only this machine can connect, and everybody on it is an operator")
    else:
        console.print(f"ok    number of keys: {len(content.keys)}")
    existing = next(folder for folder in (data, *data.resolve().parents) if folder.is_dir())
    require_space(existing, 0)
    console.print(f"ok    data folder {data}")
    return True


def _offline(console: Console, cell: CellConfig, cell_file: Path) -> bool:
    """Checks what needs no device: the calibration, its age, and the reach of the arm."""
    calibration = cell_config.load_calibration(cell_file.parent / cell.calibration)
    console.print(f"ok    calibration of {calibration.made_at}: {calibration.width} × {calibration.height} pixels")
    good = datetime.now().astimezone() < calibration.valid_until
    if not good:
        console.print(f"WRONG {ErrorCode.RIG_NOT_READY}: the calibration expired on {calibration.valid_until:%Y-%m-%d}")
        console.print("        what to do: calibrate again; until then no session starts.")
    good &= _looks_at_object(console, cell, calibration)
    _bodies(console, cell, calibration)
    _motions(console, cell, calibration)
    return good


def _looks_at_object(console: Console, cell: CellConfig, calibration: Calibration) -> bool:
    """Checks that the middle of the object's place is in the image, by the calibration."""
    keep_out = cell.object.keep_out
    middle = geometry.transform(keep_out.base_from_object.matrix, [0.0, 0.0, keep_out.height_m / 2])
    view = geometry.transform(geometry.inverse(lamp_pose.base_from_view(calibration)), middle[None])
    away_m, (column, row) = -float(view[0, 2]), photometry.project(calibration, view)[0]
    where = (
        "behind the camera" if away_m <= 0 else f"{away_m:.2f} m before the camera, at pixel ({column:.0f}, {row:.0f})"
    )
    if away_m > 0 and 0 <= column < calibration.width and 0 <= row < calibration.height:
        wide = 2 * keep_out.radius_m * calibration.camera_matrix[0][0] / away_m
        console.print(f"ok    view: the middle of the object's place is {where}; the place is {wide:.0f} pixels wide")
        return True
    console.print(f"WRONG {ErrorCode.CONFIG_INVALID}: the middle of the object's place is {where}, not in the image")
    console.print(
        "        what to do: correct `base_from_camera` and `camera_matrix` in calibration.json, or `base_from_object` "
        "of the keep-out; lengths are in m, the camera's z looks forward."
    )
    return False


def _bodies(console: Console, cell: CellConfig, calibration: Calibration) -> None:
    """Names bodies that no part of the arm can touch from wherever it stands: usually a length in another unit."""
    scene = collision.scene(cell, calibration)
    span_m = 2 * float((scene.lever_arms[:, 0] + scene.capsules[:, 6]).max())
    for name, away_m in zip(scene.names, scene.clearance(np.array([cell.arm.home]))[0], strict=False):
        if away_m > span_m:
            console.print(
                f"      {name} is never in the way: {away_m:.1f} m from the arm, which spans {span_m:.1f} m. Correct "
                "it if that is wrong; lengths are in m"
            )


def _motions(console: Console, cell: CellConfig, calibration: Calibration) -> None:
    """Computes reach, pilot and route as the service does, and prints them."""
    with TemporaryDirectory() as folder:
        cache = Path(folder) / "reach.json"
        jobs.make_reach(cell, calibration, cache)
        _reach(console, ReachMap.model_validate_json(cache.read_bytes()))
        pilot = jobs.first_lights(Recipe(), cell, calibration, cache)
    for reason in pilot.reasons + pilot.notes:
        console.print(f"        {reason}")
    route = jobs.plan_route(pilot.lights, cell.arm.home, cell, calibration)
    console.print(f"ok    route of the pilot: {route.seconds:.1f} s of moves, lower bound {route.lower_bound_s:.1f} s")


def _reach(console: Console, reach: ReachMap) -> None:
    refused = [refusal.reason for refusal in reach.refusals if refusal is not None]
    console.print(f"ok    reach: {len(reach.candidates)} of {len(reach.points)} positions on the dome")
    for reason in sorted(set(refused)):
        console.print(f"        {refused.count(reason)} refused: {reason}")


def _arm(console: Console, cell: CellConfig) -> bool:
    """Checks that the arm answers and agrees with the cell file."""
    arm = wiring.build_arm(cell)
    try:
        identity = arm.connect()
        console.print(f"ok    arm: {identity.model}, serial number {identity.serial}, software {identity.software}")
        for limit in arm.limits():
            console.print(f"      {limit}")
        findings = arm.preflight()
    finally:
        arm.close()
    for finding in findings:
        console.print(f"WRONG {ErrorCode.ARM_PREFLIGHT}: {finding.what}")
        console.print(f"        what to do: {finding.remedy}")
    return not findings


def _camera(console: Console, cell: CellConfig, cell_file: Path) -> bool:
    """Checks that the camera answers and fits the calibration."""
    camera = wiring.build_camera(cell.camera)
    try:
        camera.connect()
    finally:
        camera.close()
    known = camera.capabilities
    assert known is not None  # noqa: S101 - connecting has set it
    calibration = cell_config.load_calibration(cell_file.parent / cell.calibration)
    for warning in camera_fit.require_fit(known, calibration, cell.camera):
        console.print(f"      {warning}")
    console.print(f"ok    camera of kind '{cell.camera.kind}' answers: {known.name}")
    return True


def _factory_calibration(console: Console, cell: CellConfig) -> bool:
    """Compares the controller's factory calibration (DH parameters) with the cell file; prints the file's lines."""
    reported = primary.kinematics(cell.arm.address)
    if reported is None:
        console.print("      the controller does not report the arm's factory calibration")
    elif reported == cell.arm.kinematics:
        console.print("ok    the arm's factory calibration matches the cell file")
    else:
        wrong = cell.arm.kinematics is not None
        found = "WRONG the cell file has another" if wrong else "      the cell file has no"
        console.print(f"{found} factory calibration of the arm; put the arm's own under [arm]:")
        console.print("kinematics = [")
        for joint in reported:
            numbers = ", ".join(f"{name} = {value!r}" for name, value in joint.model_dump().items())
            console.print(f"  {{ {numbers} }},")
        console.print("]")
        return not wrong
    return True


def _print_finding(console: Console, error: RigError) -> None:
    console.print(f"WRONG {error.code}: {error.detail}")
    console.print(f"        what to do: {REMEDIES.get(error.code, PROBLEMS[error.code].remedy)}")
