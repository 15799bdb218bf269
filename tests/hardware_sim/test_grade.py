from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import grade, nominal
from hardware_sim.truth import Truth, load

SIZE = 200


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return nominal.calibration(SIZE)


@pytest.fixture(scope="module")
def ball() -> Truth:
    """A hemisphere that fills most of the picture, as a distant camera would see it."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    across, up = (x - 99.5) / 90, (99.5 - y) / 90
    inside = across**2 + up**2 < 1
    height = np.sqrt(np.where(inside, 1 - across**2 - up**2, 0))
    normals = np.where(inside[..., None], np.stack([across, up, height], axis=-1), 0).astype(np.float32)
    return Truth(normals, np.where(inside, 0.85, 0).astype(np.float32), inside.astype(np.float32), inside)


def perturbed_normals(normals: np.ndarray, angles_rad: np.ndarray, seed: int = 3) -> np.ndarray:
    """Each normal turned by its angle round a random axis at right angles to it."""
    axes = np.cross(normals, np.random.default_rng(seed).normal(size=normals.shape))
    axes /= np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-9)
    angles = np.asarray(angles_rad)[..., None]
    return (np.cos(angles) * normals + np.sin(angles) * np.cross(axes, normals)).astype(np.float32)


def test_grade_perfect_normals_gives_zero_error_and_full_coverage(ball: Truth, calibration: Calibration) -> None:
    result = grade.grade(ball.normals, ball.mask, None, ball, calibration)
    assert result.mean_deg < 1e-3
    assert result.coverage == 1.0
    assert result.found_to_predicted is None


def test_gradings_wider_sets_hold_narrower_ones(ball: Truth, calibration: Calibration) -> None:
    left = np.zeros_like(ball.mask)
    left[:, : SIZE // 2] = True
    truth = replace(ball, one_surface=ball.mask & left)
    sets = {name: grade.graded_pixels(truth, calibration, name) for name in grade.GRADINGS}
    np.testing.assert_array_equal(sets["one_surface"], sets["within_78_deg"] & left)
    np.testing.assert_array_equal(sets["object"], ball.mask)
    assert not np.any(sets["within_78_deg"] & ~sets["object"])
    wrong = perturbed_normals(ball.normals, np.where(left, 0.02, 0.06))
    means = [grade.grade(wrong, ball.mask, None, truth, calibration, name).mean_deg for name in grade.GRADINGS]
    assert means[0] == pytest.approx(np.degrees(0.02), rel=1e-3)
    assert means[2] == pytest.approx(np.degrees(0.04), rel=1e-2)


def test_grading_one_surface_unknown_is_refused(ball: Truth, calibration: Calibration) -> None:
    with pytest.raises(RigError, match="one_surface"):
        grade.grade(ball.normals, ball.mask, None, ball, calibration, "one_surface")


def test_truth_file_keeps_every_array(ball: Truth, tmp_path: Path) -> None:
    for truth in (ball, replace(ball, one_surface=ball.mask)):
        truth.save(tmp_path / "truth.npz")
        loaded = load(tmp_path / "truth.npz")
        np.testing.assert_array_equal(loaded.normals, truth.normals)
        assert (loaded.one_surface is None) == (truth.one_surface is None)
        assert truth.one_surface is None or np.array_equal(loaded.one_surface, truth.one_surface)


def test_grade_known_errors_are_measured(ball: Truth, calibration: Calibration) -> None:
    result = grade.grade(
        perturbed_normals(ball.normals, np.full(ball.mask.shape, 0.02)), ball.mask, None, ball, calibration
    )
    expected = np.degrees(0.02)
    assert result.mean_deg == pytest.approx(expected, rel=1e-3)
    assert result.median_deg == pytest.approx(expected, rel=1e-3)
    assert result.p95_deg == pytest.approx(expected, rel=1e-3)
    assert result.share_over_10_deg == 0


def test_graded_pixels_lie_within_78_degrees_of_viewing_ray(ball: Truth, calibration: Calibration) -> None:
    pixels = grade.graded_pixels(ball, calibration)
    cosine = (ball.normals * grade.viewing_rays(calibration)).sum(axis=-1)
    assert cosine[pixels].min() > np.cos(np.radians(78))
    assert not pixels[ball.mask & (cosine < np.cos(np.radians(78.01)))].any()
    inner = cv2.erode(ball.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert pixels[inner & (cosine > np.cos(np.radians(77.99)))].all()
    assert (inner & ~pixels).sum() > 500


def test_graded_pixels_exclude_mask_border(calibration: Calibration) -> None:
    mask = np.zeros((SIZE, SIZE), bool)
    mask[50:60, 70:90] = True
    mask[0:5, 0:5] = True
    facing = np.where(mask[..., None], np.array([0, 0, 1.0]), 0).astype(np.float32)
    flat = Truth(facing, mask.astype(np.float32), mask.astype(np.float32), mask)
    pixels = grade.graded_pixels(flat, calibration)
    assert pixels[51:59, 71:89].all()
    assert pixels.sum() == 8 * 18 + 3 * 3  # the picture's border counts as outside


def test_viewing_rays_point_to_camera(calibration: Calibration) -> None:
    rays = grade.viewing_rays(calibration)
    assert rays[100, 100] == pytest.approx([0, 0, 1], abs=1e-3)
    assert rays[0, 0, 0] > 0.1  # a point on the left sees the camera to its right
    assert rays[0, 0, 1] < -0.1  # a point at the top sees it below


def test_grade_unsolved_pixels_lower_coverage_only(ball: Truth, calibration: Calibration) -> None:
    mask = ball.mask.copy()
    mask[:, :100] = False
    wrong_outside = ball.normals.copy()
    wrong_outside[:, :100] = [1, 0, 0]
    result = grade.grade(wrong_outside, mask, None, ball, calibration)
    assert result.mean_deg < 1e-3
    assert result.coverage == pytest.approx(0.5, abs=0.01)


def test_grade_zero_normal_counts_as_unsolved(ball: Truth, calibration: Calibration) -> None:
    normals = ball.normals.copy()
    normals[:100] = 0
    assert grade.grade(normals, ball.mask, None, ball, calibration).coverage == pytest.approx(0.5, abs=0.01)


def test_grade_calibrated_sigma_has_expected_shares(ball: Truth, calibration: Calibration) -> None:
    """Errors drawn as σ is defined: variance σ² / 2 along each of two tangents, so that they are Rayleigh."""
    random = np.random.default_rng(5)
    sigma = random.uniform(0.3, 0.5, ball.mask.shape)
    errors = np.radians(np.hypot(*(random.normal(size=(2, *sigma.shape)) * sigma / np.sqrt(2))))
    result = grade.grade(
        perturbed_normals(ball.normals, errors), ball.mask, sigma.astype(np.float32), ball, calibration
    )
    assert result.found_to_predicted == pytest.approx(1.0, abs=0.05)
    assert result.within_sigma == pytest.approx(0.632, abs=0.015)
    assert result.within_two_sigma == pytest.approx(0.982, abs=0.005)
    too_small = grade.grade(
        perturbed_normals(ball.normals, errors), ball.mask, (sigma / 2).astype(np.float32), ball, calibration
    )
    assert too_small.found_to_predicted == pytest.approx(2.0, abs=0.1)


def test_grade_folder_reads_results(ball: Truth, calibration: Calibration, tmp_path: Path) -> None:
    normals = perturbed_normals(ball.normals, np.full(ball.mask.shape, 0.01))
    tifffile.imwrite(tmp_path / "normals.tiff", normals, photometric="rgb")
    cv2.imwrite(str(tmp_path / "mask.png"), ball.mask.astype(np.uint8) * 255)
    without = grade.grade_folder(tmp_path, ball, calibration)
    tifffile.imwrite(tmp_path / "sigma_deg.tiff", np.full(ball.mask.shape, 0.7, np.float32))
    result = grade.grade_folder(tmp_path, ball, calibration)
    assert without.predicted_median_deg is None
    assert result.mean_deg == pytest.approx(np.degrees(0.01), rel=1e-3)
    assert result.predicted_median_deg == pytest.approx(0.833 * 0.7, rel=1e-4)
    assert set(result.as_dict()) >= {"mean_deg", "median_deg", "p95_deg", "coverage"}


@pytest.mark.parametrize("damage", ["normals.tiff", "mask.png", "sigma_deg.tiff"])
def test_grade_folder_damaged_file_is_named(ball: Truth, calibration: Calibration, tmp_path: Path, damage: str) -> None:
    tifffile.imwrite(tmp_path / "normals.tiff", ball.normals, photometric="rgb")
    tifffile.imwrite(tmp_path / "sigma_deg.tiff", ball.normals[..., 0])
    cv2.imwrite(str(tmp_path / "mask.png"), ball.mask.astype(np.uint8))
    (tmp_path / damage).write_bytes(b"nonsense")
    with pytest.raises(RigError, match=damage) as caught:
        grade.grade_folder(tmp_path, ball, calibration)
    assert caught.value.code == ErrorCode.STORE_CORRUPT


def test_grade_other_size_or_empty_mask_raises(ball: Truth, calibration: Calibration) -> None:
    with pytest.raises(RigError, match="shape"):
        grade.grade(ball.normals[:100], ball.mask[:100], None, ball, calibration)
    with pytest.raises(RigError, match="no graded pixel"):
        grade.grade(ball.normals, np.zeros_like(ball.mask), None, ball, calibration)
