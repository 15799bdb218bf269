"""Jobs of sessions that check the calibration in use: poses, and the comparison with what it predicts.

They are pure except for the files of an estimate, which are written as a whole: an existing folder is complete. A check
makes no calibration: it finds that the one in use still predicts the images, or what has moved.
"""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from acquisition.calibrate import (
    board_check,
    board_session,
    change_test,
    lamp_check,
    lamp_session,
    lamp_targets,
    stated_values,
)  # fmt: skip
from acquisition.calibrate.board_results import now
from acquisition.calibrate.change_test import ChangeTest, GroupTest
from acquisition.formats.atomic_write import atomic_folder, discard_partial
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_check import CheckedImage, CheckResult, PartTest
from acquisition.models.calibration_recipe import BoardRecipe, CheckRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import LightPlan
from acquisition.models.shot import Observations
from acquisition.runner import board_jobs, lamp_jobs
from acquisition.runner.estimate_files import SUMMARY, write_json

CHECK = "check.json"


def check_poses(
    recipe: CheckRecipe, cell: CellConfig, calibration: Calibration, observations: Observations, set_folder: Path | None
) -> LightPlan:
    """Plans the poses of a check: views of the board that tell camera, board and joints apart, or lamps over the plane.

    `set_folder` is that of the calibration set in use. Raises RigError calibration.infeasible if the set states nothing
    to check against, and waypoints.unreachable.
    """
    if recipe.target == "plane":
        stated_values.lamp(set_folder, calibration)
        return lamp_jobs.plane_poses(recipe.max_images, recipe.seed + 7, cell, calibration)
    board_check.stated(set_folder, calibration)
    views = BoardRecipe(kind="hand-eye", max_images=max(recipe.max_images, 8), seed=recipe.seed)
    plan = board_jobs.board_poses(views, cell, calibration, observations, None)
    return plan.model_copy(
        update={name: getattr(plan, name)[: recipe.max_images] for name in ("lights", "reasons", "joints")}
    )


def estimate_check(
    recipe: CheckRecipe, cell: CellConfig, calibration: Calibration, observations: Observations,
    set_folder: Path | None, folder: Path,
) -> CalibrationSummary:  # fmt: skip
    """Compares a session's images with what the calibration in use predicts, and writes the estimate's folder.

    Raises RigError calibration.infeasible.
    """
    compared = _board if recipe.target == "board" else _plane
    found, deviations, sentence = compared(cell, calibration, observations, set_folder)
    hashes = {shot.frame.path: shot.frame.sha256 for shot in observations.shots}
    result = _result(recipe, calibration, found, hashes, deviations, sentence)
    summary = CalibrationSummary(
        kind=recipe.kind, images=len(hashes), used=len(deviations), estimated=True, reached=True, passed=result.passed,
        changed=[test.name for test in result.changed], probability=result.probability,
        fingerprint=calibration.fingerprint, advice=list(result.advice),
    )  # fmt: skip
    discard_partial(folder)
    with atomic_folder(folder) as partial:
        write_json(partial / CHECK, result)
        write_json(partial / SUMMARY, summary)
    return summary


_Compared = tuple[ChangeTest, dict[str, float], Callable[[GroupTest], str]]
"""Tests, deviation of each image by its name, and the function that puts a test into words."""


def _board(
    cell: CellConfig, calibration: Calibration, observations: Observations, set_folder: Path | None
) -> _Compared:
    basis = board_check.stated(set_folder, calibration)
    views = board_session.read(observations, cell).views
    made = board_check.check(board_session.model_of(cell), views, basis)
    return made.found, dict(zip((view.name for view in views), made.residuals_px, strict=True)), board_check.sentence


def _plane(
    cell: CellConfig, calibration: Calibration, observations: Observations, set_folder: Path | None
) -> _Compared:
    targets, board = lamp_targets.require_targets(cell), lamp_targets.plane_board(cell)
    stated = stated_values.lamp(set_folder, calibration)
    images, placing = lamp_session.read_placing(observations, 0, 0, cell, calibration)
    given = lamp_check.known_of(stated, calibration, targets.albedo, board.size_m)
    made = lamp_check.check(images, placing, given, stated.lobe, targets.albedo_sigma)
    seen = [image.name for image in images if len(image.values)]
    return made.found, dict(zip(seen, made.offsets, strict=True)), lamp_check.sentence


def _result(
    recipe: CheckRecipe, calibration: Calibration, found: ChangeTest, hashes: dict[str, str],
    deviations: dict[str, float], sentence: Callable[[GroupTest], str],
) -> CheckResult:  # fmt: skip
    changed = tuple(_part(test, sentence) for test in found.changed)
    # A board that was mounted anew sits differently: this is named, and is no fault of the calibration.
    passed = all(test.name == board_check.BOARD_PLACE for test in changed)
    return CheckResult(
        target=recipe.target,
        made_at=now(),
        version=version("lightpose"),
        fingerprint=calibration.fingerprint,
        passed=passed,
        probability=found.probability,
        false_alarm=change_test.FALSE_ALARM,
        changed=changed,
        tests=tuple(_part(test, sentence) for test in found.tests),
        worst=max(deviations, key=lambda name: abs(deviations[name])),
        images=tuple(
            CheckedImage(image=name, sha256=digest, deviation=deviations.get(name)) for name, digest in hashes.items()
        ),
        advice=_advice(passed, changed),
    )


def _part(test: GroupTest, sentence: Callable[[GroupTest], str]) -> PartTest:
    return PartTest(
        name=test.group.name, change=tuple(test.change.tolist()),
        sigma=tuple(np.sqrt(np.maximum(np.diag(test.covariance), 0)).tolist()), chi_square=test.chi_square,
        freedom=test.freedom, probability=test.probability, sentence=sentence(test),
    )  # fmt: skip


def _advice(passed: bool, changed: Sequence[PartTest]) -> tuple[str, ...]:
    said = [f"What has most likely changed: {test.sentence}." for test in changed]
    if passed:
        return (*said, "The calibration in use still predicts the images.")
    kind = "lamp" if {test.name for test in changed} & {"intensity", "lobe", "lamp"} else "hand-eye"
    return (
        *said,
        f"The calibration in use no longer predicts the images: check for loose parts, then calibrate {kind} again.",
    )
