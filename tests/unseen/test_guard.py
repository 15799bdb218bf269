"""The guard distinguishes equal results from turned normals, other σ, other pixels and other plans."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.unseen import guard
from tests.unseen.guard import Result

NAME = "relief, Lambert"


@pytest.fixture
def result() -> Result:
    normals = np.zeros((4, 5, 3), np.float32)
    normals[..., 2] = 1
    sigma = np.full((4, 5), 2.0, np.float32)
    sigma[0, 0] = np.nan
    return Result(normals, sigma, np.ones((4, 5), np.float32), np.full((4, 5), 1.0), np.arange(7.0))


def turned(result: Result, angle_deg: float) -> Result:
    angle = np.radians(angle_deg)
    normals = np.zeros_like(result.normals)
    normals[..., 0], normals[..., 2] = np.sin(angle), np.cos(angle)
    return replace(result, normals=normals)


def compared(folder: Path, one: Result, other: Result, within_deg: float = 0.0, within_share: float = 0.0) -> bool:
    for name, each in (("one", one), ("other", other)):
        (folder / name).mkdir(exist_ok=True)
        guard.store(folder / name, NAME, each)
    return guard.compare(folder / "one", folder / "other", [NAME], within_deg, within_share)


def test_compare_of_equal_results_says_identical(
    tmp_path: Path, result: Result, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compared(tmp_path, result, replace(result))
    assert capsys.readouterr().out.split()[-1] == "identical"


def test_compare_of_turned_normals_passes_within_the_bound(tmp_path: Path, result: Result) -> None:
    assert guard.differences(turned(result, 0.5), result)[0] == pytest.approx(0.5, rel=1e-3)
    assert compared(tmp_path, turned(result, 0.5), result, within_deg=0.6)
    assert not compared(tmp_path, turned(result, 0.5), result, within_deg=0.4)


def test_compare_of_other_sigma_or_plan_fails(tmp_path: Path, result: Result) -> None:
    assert not compared(tmp_path, replace(result, sigma_deg=1.1 * result.sigma_deg), result, within_share=0.05)
    assert not compared(tmp_path, replace(result, plan=result.plan + 0.1), result, within_share=0.05)
    assert compared(tmp_path, replace(result, sigma_deg=1.01 * result.sigma_deg), result, within_share=0.05)


def test_compare_of_other_solved_pixels_fails_within_any_bound(tmp_path: Path, result: Result) -> None:
    sigma = result.sigma_deg.copy()
    sigma[1, 1] = np.nan
    assert not compared(tmp_path, replace(result, sigma_deg=sigma), result, 90.0, 90.0)


def test_figures_leave_out_ungraded_pixels(result: Result) -> None:
    error = result.error_deg.copy()
    error[1:] = np.nan
    assert replace(result, error_deg=error).figures() == pytest.approx((1.0, 2.0, 0.5))
