"""Grading of calibrations against the perturbed cell's truth: nothing off for the truth, what was drawn for nominal."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import grade_calibration, nominal, true_cell

CELL = cell_config.load(nominal.default_cell_file())
NOMINAL = nominal.calibration(512)
JOINTS = [(-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423), (3.0, -1.2, 1.5, -1.5, -1.4, 1.0)]


@pytest.fixture
def truth(tmp_path: Path) -> dict[str, Any]:
    true_cell.perturbed(NOMINAL, 4).save(tmp_path / "calibration_truth.json")
    return grade_calibration.load(tmp_path / "calibration_truth.json")


def test_errors_nominal_values_are_off_as_drawn(truth: dict[str, Any]) -> None:
    found = grade_calibration.errors(NOMINAL, truth)
    assert found.lamp_mm == pytest.approx(10)
    assert found.camera_mm == pytest.approx(5)
    assert found.camera_deg == pytest.approx(0.5)
    assert found.focal_percent == pytest.approx(1, rel=0.02)
    assert found.intensity_percent == pytest.approx(5, rel=0.06)
    assert found.lobe_percent > 3
    assert 0.5 < found.flat_field_percent < 2  # of the 2 % that the corners lose, and 1 % on one side


def test_errors_true_values_are_none(truth: dict[str, Any]) -> None:
    true = grade_calibration.true_calibration(NOMINAL, truth)
    found = grade_calibration.errors(true, truth)
    assert max(found.lamp_mm, found.camera_mm, found.camera_deg, found.focal_percent) < 1e-6
    assert found.intensity_percent < 1e-6
    assert found.lobe_percent < 0.1
    assert found.flat_field_percent < 0.01
    assert grade_calibration.direction_deg(true, true, CELL, JOINTS) == 0
    assert 0.3 < grade_calibration.direction_deg(NOMINAL, true, CELL, JOINTS) < 4


def test_error_probabilities_follow_from_covariances(truth: dict[str, Any]) -> None:
    lamp, camera = np.eye(3) * 0.01**2 / 3, np.diag([0.005**2 / 3] * 3 + [np.radians(0.5) ** 2 / 3] * 3)
    stated = NOMINAL.model_copy(
        update={"tool_from_lamp_covariance": lamp.tolist(), "base_from_camera_covariance": camera.tolist()}
    )
    found = grade_calibration.error_probabilities(stated, truth)
    # Errors of one standard deviation for each unknown: χ² of 3 and of 6 at their means.
    assert found == pytest.approx({"lamp": 0.6084, "camera": 0.5768}, abs=1e-3)


def test_true_calibration_five_coefficients_are_near_the_lens(truth: dict[str, Any]) -> None:
    true = grade_calibration.true_calibration(NOMINAL, truth)
    rays = np.array([[x, y, 1.0] for x in (-0.1, 0, 0.1) for y in (-0.1, 0.0, 0.1)])
    matrix = np.array(truth["camera_matrix"])
    both = [
        cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(one))[0].reshape(-1, 2)
        for one in (truth["distortion"], true.distortion)
    ]
    assert np.abs(both[0] - both[1]).max() < 0.05


def test_in_view_of_other_camera_turns_normals(truth: dict[str, Any]) -> None:
    true = grade_calibration.true_calibration(NOMINAL, truth)
    up = np.tile(np.array([0, 0, 1], np.float32), (2, 2, 1))
    turned = grade_calibration.in_view_of(up, true, NOMINAL)
    base = np.array(true.base_from_camera)[:3, 2], np.array(NOMINAL.base_from_camera)[:3, 2]
    assert turned[0, 0] @ [0, 0, 1] == pytest.approx(base[0] @ base[1], abs=1e-6)
    back = grade_calibration.in_view_of(turned, NOMINAL, true)
    np.testing.assert_allclose(back, up, atol=1e-6)


def test_load_damaged_truth_is_named(tmp_path: Path) -> None:
    (tmp_path / "calibration_truth.json").write_text("{", encoding="utf-8")
    with pytest.raises(RigError, match="not a ground-truth file") as caught:
        grade_calibration.load(tmp_path / "calibration_truth.json")
    assert caught.value.code is ErrorCode.STORE_CORRUPT
