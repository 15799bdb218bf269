"""`lightpose demo --calibrate --perturb`: a cell that was never calibrated calibrates itself, and is graded.

Cell and service are separate processes, as in `demo`. The sessions are those of `lightpose calibrate all`, with the
simulated stage in place of a person. Then an object is captured with the resulting calibration, and the same images are
solved again with the true values, so that only the calibration differs. Only the grading reads the truth.
"""

import json
import shutil
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import tifffile
from rich.console import Console

from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import AnyRecipe, BoardRecipe, LampRecipe
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.calibration_sets import CalibrationSets
from acquisition.store.folder import write_value
from api import ProblemError
from api.cli import calibrating_in_turn, demo
from api.cli.calibrating_in_turn import SimulatedHands
from api.cli.demo import DemoOptions
from api.client.client import Client
from hardware_sim import grade, grade_calibration, object_spec, placing, truth
from hardware_sim.controller.trace import read_trace
from hardware_sim.grade import Grade
from hardware_sim.truth import Truth

RECIPES: tuple[AnyRecipe, ...] = (
    BoardRecipe(kind="hand-eye", max_images=36),
    LampRecipe(kind="lamp"),
)
"""Calibrations of the demonstration and their numbers of images, as in `lightpose calibrate all`. The camera comes from
the hand-eye session's images; a separate session would take a fifth of all images without further information."""

AT_REST_RAD = 1e-7
"""Motion of a joint between two ticks above which the arm counts as moving, rad."""

READOUT_S = 0.1
"""Time for a camera to read out and send an image, s."""

PROCESSOR_METRIC = "lightpose_compute_processor_seconds_total"
"""Name of the service's metric for the processor time of its computations."""

POLL_S = 0.2
"""Time between two requests for a result, s."""

TRUE_SET = "true-values"
"""Identifier of the set of true values with which the object's images are solved again."""


def run(options: DemoOptions, *, quiet: bool = False) -> dict[str, Any]:
    """Calibrates a perturbed cell from nothing, captures an object, and returns the errors of both.

    `motion_seconds` is the time for which the arm moves at its true speed, `stopped_seconds` that for which it stands
    for images, and `computing_processor_seconds` the processor time of plans, routes, checks of frames and estimates.
    `simulated_seconds` is their sum, which other load of this machine does not lengthen. `computing_seconds` is the
    duration of plans, routes and estimates on this machine, beside whatever else ran.

    Raises RigError as `demo.run`, and with the reason of a calibration that fails.
    """
    console = Console(quiet=quiet)

    def say(sentence: str) -> None:
        console.print(sentence, highlight=False, soft_wrap=True)

    _require_built_in(options)
    folder = demo.prepared_folder(options)
    record = folder / "cell" / "ticks.record"
    record.unlink(missing_ok=True)
    begun = time.monotonic()
    # The object is placed after the calibration, so that it is not rendered in vain before.
    with (
        demo.cell(replace(options, spec=object_spec.as_spec("empty")), folder) as cell_file,
        demo.service(cell_file, folder) as url,
        Client(url) as client,
    ):
        cell = cell_config.load(cell_file)
        nominal = cell_config.load_calibration(cell_file.parent / "calibration.json")
        if not isinstance(cell.camera, SimCameraConfig):
            raise RigError(ErrorCode.CONFIG_INVALID, "The demonstration needs a simulated camera")
        hands = SimulatedHands(say, cell.camera.address, cell.camera.port)
        demo.end_previous_session(client)
        client.activate_calibration("cell")
        client.state_tool("lamp")
        sessions = calibrating_in_turn.run(client, RECIPES, hands, say, lambda _name: True)
        processor_s = _processor_s(url)
        motion_s = _motion_s(record, options.speed)
        found = _calibration(folder, sessions[-1].id)
        true = _keep_truth(folder, cell_file.parent / "calibration_truth.json", nominal, sessions[-1].id)
        client.state_tool("lamp")
        placing.place(cell.camera.address, cell.camera.port, options.spec.name)
        captured = demo.capture(client, demo.recipe_of(options, options.method))
        solved = client.results(captured)[-1].number
        again = client.resolve(captured, calibration=TRUE_SET)
        _await_result(client, captured, again)
        seconds = [demo.seconds_of(client, session.id) for session in sessions]
    stopped_s = sum(_stopped_s(folder, session.id, cell) for session in sessions)
    computing_s = sum(sum(value for name, value in one.items() if name != "capture") for one in seconds)
    known = truth.load(cell_file.parent / "truth.npz")
    graded = [
        _grade(folder / "data" / "sessions" / captured / "results" / str(number), known, calibration, nominal)
        for number, calibration in ((solved, found), (again, true))
    ]
    facts = grade_calibration.load(cell_file.parent / "calibration_truth.json")
    errors = grade_calibration.errors(found, facts)
    joints = [shot["joints"] for shot in _shots(folder, captured) if shot["kind"] == "light"]
    outcome = {
        **{name: round(value, 4) for name, value in asdict(errors).items()},
        "lamp_direction_deg": round(grade_calibration.direction_deg(found, true, cell, joints), 4),
        "mean_deg": round(graded[0].mean_deg, 4),
        "mean_deg_true_calibration": round(graded[1].mean_deg, 4),
        "motion_seconds": round(motion_s, 1),
        "stopped_seconds": round(stopped_s, 1),
        "simulated_seconds": round(motion_s + stopped_s + processor_s, 1),
        "computing_seconds": round(computing_s, 1),
        "computing_processor_seconds": round(processor_s, 1),
        "error_probabilities": {
            name: round(value, 4) for name, value in grade_calibration.error_probabilities(found, facts).items()
        },
        "seconds": round(time.monotonic() - begun, 1),
        "seed": options.seed,
    }
    for name, value in outcome.items():
        say(f"{name}: {value}")
    return outcome


def _require_built_in(options: DemoOptions) -> None:
    """Raises RigError request.invalid for an object that the simulated stage cannot put into a running cell."""
    if options.spec.source != "built-in" or options.spec.size_mm is not None or options.spec.reflectance is not None:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            "--calibrate works only with built-in objects: give --object NAME and no other option of the object",
        )


def _calibration(folder: Path, identity: str) -> Calibration:
    return CalibrationSets(folder / "data" / "calibrations").calibration(identity)


def _keep_truth(folder: Path, file: Path, nominal: Calibration, like: str) -> Calibration:
    """Stores the true values as a set, described like the set `like`, so that images can be solved with them."""
    sets = CalibrationSets(folder / "data" / "calibrations")
    shutil.rmtree(folder / "data" / "calibrations" / TRUE_SET, ignore_errors=True)  # of an earlier demonstration
    true = grade_calibration.true_calibration(nominal, grade_calibration.load(file))
    described = sets.get(like).model_copy(
        update={"id": TRUE_SET, "fingerprint": true.fingerprint, "kind": "truth", "images": {}}
    )
    with tempfile.TemporaryDirectory() as estimate:
        write_value(Path(estimate) / "calibration.json", true)
        sets.add(described, Path(estimate))
    return true


def _await_result(client: Client, session_id: str, number: int) -> None:
    """Waits until a requested solve is done. Raises ProblemError if it fails."""
    while True:
        try:
            client.result(session_id, number)
        except ProblemError as error:
            if error.code is not ErrorCode.RESULT_NOT_READY:
                raise
            time.sleep(POLL_S)
        else:
            return


def _shots(folder: Path, session_id: str) -> list[dict[str, Any]]:
    manifest = folder / "data" / "sessions" / session_id / "manifest.json"
    return json.loads(manifest.read_text(encoding="utf-8"))["shots"]


def _motion_s(record: Path, speed: float) -> float:
    """Returns the duration of the arm's motion at its true speed, s."""
    trace = read_trace(record)
    moving = np.abs(np.diff(trace.joints, axis=0)).max(axis=1) > AT_REST_RAD
    return speed * float(np.diff(trace.times)[moving].sum())


def _processor_s(url: str) -> float:
    """Returns the processor time of the service's computations so far, s, which other load does not lengthen."""
    lines = httpx.get(f"{url}/metrics", timeout=60, trust_env=False).text.splitlines()
    return sum(float(line.split()[-1]) for line in lines if line.startswith(f"{PROCESSOR_METRIC}{{"))


def _stopped_s(folder: Path, session_id: str, cell: CellConfig) -> float:
    """Returns the time for which the arm has stood for images, s: settling, the lamp's rise, and each exposure."""
    return sum(
        cell.arm.settle_s + (shot["attempt"] + 1) * (cell.lamp.rise_s + shot["exposure_s"] + READOUT_S)
        for shot in _shots(folder, session_id)
    )


def _grade(result: Path, true: Truth, solved_with: Calibration, nominal: Calibration) -> Grade:
    """Grades a result in the truth's view frame, that of the nominal camera."""
    normals = np.asarray(tifffile.imread(result / "normals.tiff"), dtype=np.float32)
    mask = np.asarray(cv2.imread(str(result / "mask.png"), cv2.IMREAD_UNCHANGED)) > 0
    return grade.grade(grade_calibration.in_view_of(normals, solved_with, nominal), mask, None, true, nominal)
