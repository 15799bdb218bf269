"""White balance and matrix from images of the simulated chart, whose reference values are its spectra's."""

from pathlib import Path

import numpy as np
import pytest

from acquisition import mosaic
from acquisition.calibrate import chart_reference, colour_chart
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import spectra
from tests.acquisition.calibrate import chart_images
from tests.acquisition.calibrate.chart_images import SENSOR

CLIPPED_FROM = 0.98 * SENSOR.full_scale_dn


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    """Two placings, values above black."""
    return [chart_images.frame(seed).astype(np.float64) - SENSOR.black_level_dn for seed in (0, 1)]


@pytest.fixture(scope="module")
def signals(images: list[np.ndarray]) -> np.ndarray:
    names = chart_images.reference().names
    found = [
        colour_chart.values(
            one, colour_chart.locate(mosaic.balanced_mean(one.astype(np.float32))), "rggb", CLIPPED_FROM, names
        )
        for one in images
    ]
    return np.array(found) / SENSOR.full_scale_dn


def test_fit_of_a_noisy_unevenly_lit_chart_is_within_two_delta_e(signals: np.ndarray) -> None:
    found = colour_chart.fit(signals, chart_images.reference())
    assert found.calibration.delta_e_mean < 1.2
    assert found.calibration.delta_e_max < 2.5
    np.testing.assert_allclose(found.calibration.white, spectra.white(), rtol=0.03)
    np.testing.assert_allclose(np.array(found.calibration.matrix).sum(axis=1), 1, atol=1e-9)
    assert np.ptp(found.shading) > 0.1  # the lamp stands half a metre away


def test_held_out_image_is_as_good_as_fitted_ones(signals: np.ndarray) -> None:
    apart = colour_chart.held_out_delta_e(signals, chart_images.reference())
    assert apart is not None
    assert apart < 1.5
    assert colour_chart.held_out_delta_e(signals[:1], chart_images.reference()) is None


def test_fit_of_a_chart_in_another_order_is_refused(signals: np.ndarray) -> None:
    turned = signals[:, ::-1]
    with pytest.raises(RigError, match="neutral patches") as refused:
        colour_chart.fit(turned, chart_images.reference())
    assert refused.value.code == ErrorCode.CALIBRATION_INFEASIBLE


def test_values_of_a_saturated_patch_names_it(images: list[np.ndarray]) -> None:
    matrix = colour_chart.locate(mosaic.balanced_mean(images[0].astype(np.float32)))
    names = chart_images.reference().names
    with pytest.raises(RigError, match=r"patch white 9\.5 is saturated"):
        colour_chart.values(images[0], matrix, "rggb", 0.7 * images[0].max(), names)
    with pytest.raises(RigError, match="closer"):
        colour_chart.values(images[0][::4, ::4], np.diag([0.25, 0.25, 1]) @ matrix, "rggb", CLIPPED_FROM, names)


def test_locate_without_markers_names_the_missing_ones(images: list[np.ndarray]) -> None:
    with pytest.raises(RigError, match="markers 0, 1, 2, 3") as refused:
        colour_chart.locate(images[0][100:200, 100:200])
    assert refused.value.code == ErrorCode.CALIBRATION_TARGET_NOT_SEEN


def test_homography_of_crossed_corners_is_refused() -> None:
    with pytest.raises(RigError, match="quadrilateral"):
        colour_chart.homography(np.array([[0, 0], [100, 100], [100, 0], [0, 100]]))


def test_published_reference_has_patches_in_order() -> None:
    known = chart_reference.published()
    assert len(known.names) == 24
    assert known.names[0] == "dark skin"
    assert np.all(np.diff(known.lab[18:, 0]) < 0)  # white to black


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("name,L,a,b\nx,50,0,0\n", "holds 1 patches"),
        ("name,L,a,b\nx,50,0\n", "line 2"),
        ("x,150,0,0\n" * 24, "0 and 100"),
    ],
)
def test_read_of_a_bad_reference_says_why(content: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "chart.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RigError, match=why) as refused:
        chart_reference.read(path)
    assert refused.value.code == ErrorCode.CONFIG_INVALID
