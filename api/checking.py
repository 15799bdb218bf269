"""What `lightpose check` says of a cell before anything moves: each thing that is wrong, with its remedy."""

import socket
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from acquisition import config, jobs
from acquisition.config import CellConfig
from acquisition.devices.ur import primary
from acquisition.errors import PROBLEMS, ErrorCode, RigError
from acquisition.types import Calibration, Recipe
from acquisition.waypoints.reach import ReachMap
from api import wiring

PROBE_S = 2.0


def check(cell_file: Path, *, offline: bool) -> bool:
    """Checks a cell and prints what it finds; True when nothing is wrong. Moves nothing."""
    console = Console(highlight=False, soft_wrap=True)
    good = True
    try:
        cell = config.load(cell_file)
        calibration = config.load_calibration(cell_file.parent / cell.calibration)
        console.print(
            f"ok    cell '{cell.name}': {cell.arm.model} at {cell.arm.address}, fingerprint {cell.fingerprint[:12]}"
        )
        console.print(f"ok    calibration of {calibration.made_at}: {calibration.width} × {calibration.height} pixels")
        _motions(console, cell, calibration)
    except RigError as error:
        _tell(console, error)
        good = False
    else:
        if not offline:
            good = _devices(console, cell)
    return good


def _motions(console: Console, cell: CellConfig, calibration: Calibration) -> None:
    """Reach, pilot and route, as the service would make them."""
    with TemporaryDirectory() as folder:
        cache = Path(folder) / "reach.json"
        jobs.make_reach(cell, calibration, cache)
        reach = ReachMap.model_validate_json(cache.read_bytes())
        pilot = jobs.first_lights(Recipe(), cell, calibration, cache)
    refused = [refusal.reason for refusal in reach.refusals if refusal is not None]
    console.print(f"ok    reach: {len(reach.candidates)} of {len(reach.points)} positions on the dome")
    for reason in sorted(set(refused)):
        console.print(f"        {refused.count(reason)} refused: {reason}")
    for reason in pilot.reasons + pilot.notes:
        console.print(f"        {reason}")
    route = jobs.plan_route(pilot.lights, cell.arm.home, cell, calibration)
    console.print(f"ok    route of the pilot: {route.seconds:.1f} s of moves, at best {route.lower_bound_s:.1f} s")


def _devices(console: Console, cell: CellConfig) -> bool:
    good = True
    for code, name, address, port in (
        (ErrorCode.ARM_UNREACHABLE, "arm, dashboard", cell.arm.address, 29999),
        (ErrorCode.ARM_UNREACHABLE, "arm, RTDE", cell.arm.address, 30004),
    ):
        try:
            socket.create_connection((address, port), PROBE_S).close()
        except OSError as error:
            _tell(console, RigError(code, f"{name} at {address}:{port}: {error}"))
            good = False
        else:
            console.print(f"ok    {name} answers at {address}:{port}")
    try:
        camera = wiring.build_camera(cell.camera)
        camera.connect()
        camera.close()
    except RigError as error:
        _tell(console, error)
        good = False
    else:
        console.print(f"ok    camera of kind '{cell.camera.kind}' answers")
    return _calibration(console, cell) and good


def _calibration(console: Console, cell: CellConfig) -> bool:
    """The arm as built: told as lines for the cell file where they are not in it."""
    try:
        told = primary.kinematics(cell.arm.address)
    except OSError as error:
        _tell(console, RigError(ErrorCode.ARM_UNREACHABLE, f"arm, calibration at {cell.arm.address}: {error}"))
        return False
    if told is None:
        console.print("      the controller does not tell the arm's factory calibration")
    elif told == cell.arm.kinematics:
        console.print("ok    the arm's factory calibration is the cell file's")
    else:
        wrong = cell.arm.kinematics is not None
        console.print(f"{'WRONG' if wrong else '     '} the arm's factory calibration; for [arm] in the cell file:")
        console.print("kinematics = [")
        for joint in told:
            numbers = ", ".join(f"{name} = {value!r}" for name, value in joint.model_dump().items())
            console.print(f"  {{ {numbers} }},", markup=False)
        console.print("]", markup=False)
        return not wrong
    return True


def _tell(console: Console, error: RigError) -> None:
    console.print(f"WRONG {error.code}: {error.detail}")
    console.print(f"        what to do: {PROBLEMS[error.code].remedy}")
