"""Intensity and lobe of the lamp from images of a matt plane, against LEDs that no spline has made."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from acquisition import photometry
from acquisition.calibrate import lamp_lobe
from acquisition.calibrate.lamp_lobe import LobeFit
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.calibrate.coverage import LEAST, MEAN_OFF, MOST, require_covered, squared
from tests.acquisition.calibrate.matt_plane import CALIBRATION, COARSE, FINE, Truth, captured

ANGLES = np.radians(np.arange(2.0, 40.0, 2.0))


def found_factors(found: LobeFit, angles: FloatArray) -> FloatArray:
    """Intensity over that on the axis as the calibration file's reader computes it."""
    table = photometry.lobe_table(found.lobe)
    ahead = np.cos(angles)
    return ahead**CALIBRATION.lobe_exponent * np.interp(ahead, np.linspace(0, 1, len(table)), table)


def whitened(found: LobeFit, truth: Truth) -> float:
    """Squared error of ln intensity, of the knots within 40° and of the tilt in standard deviations, and its count."""
    knots = np.array(found.lobe.knots_rad)[1:]
    error = np.r_[
        np.log(found.lamp_intensity / truth.intensity),
        np.log(np.array(found.lobe.factors)[1:] * np.cos(knots) ** CALIBRATION.lobe_exponent / truth.factors(knots)),
        np.array(found.lobe.tilt) - truth.lobe.tilt,
    ]
    return float(error @ np.linalg.solve(found.covariance, error))


def test_lobe_of_led_is_found_to_a_per_cent() -> None:
    truth, images, placings, known = captured(1, count=16, noise=FINE)
    found = lamp_lobe.fit(images, placings, known)
    assert found.lamp_intensity == pytest.approx(truth.intensity, rel=0.008)
    assert found_factors(found, ANGLES) == pytest.approx(truth.factors(ANGLES), rel=0.01)
    assert np.array(found.lobe.tilt) == pytest.approx(np.array(truth.lobe.tilt), abs=0.01)
    assert found.image_sigma == pytest.approx(0.005, rel=0.4)
    assert found.patch_sigma == pytest.approx(2.5e-4, rel=0.2)
    assert found.lamp_sigma_m == pytest.approx(3e-4, rel=0.3)
    assert len(found.lobe.knots_rad) >= 6  # a ring of 7° needs them
    assert min(found.held_out.values()) < 0.8 * found.held_out[4]


@pytest.mark.parametrize("sags", [-4.0, pytest.param(4.0, marks=pytest.mark.long)])
def test_lobe_of_sagging_plane_keeps_its_depth_out_of_flat_field(sags: float) -> None:
    truth, images, placings, known = captured(1, count=16, placings=1, sags=sags)
    found = lamp_lobe.fit(images, placings, known)
    assert squared(found.flat_field - truth.flat_field, found.flat_covariance) < chi2.ppf(0.99, 5) / 5


def test_lobe_verifies_on_placing_that_took_no_part() -> None:
    _, images, placings, known = captured(2, count=16)
    used = [image for image in images if image.placing == 0]
    unused = [image for image in images if image.placing == 1]
    found = lamp_lobe.fit(used, placings[:1], known)
    after = found.calibrated(known.calibration)
    before = lamp_lobe.normal_error_deg(unused, placings[1], known.calibration, 0 * found.flat_field)
    error = lamp_lobe.normal_error_deg(unused, placings[1], after, found.flat_field)
    assert error < min(0.35, 0.75 * before)  # by images that differ by 0.5 %, and lamps that are 0.4 mm off
    assert after.intensity_sigma == found.image_sigma
    assert after.flat_field is not None
    assert after.flat_field.terms == tuple(found.flat_field)


def test_lobe_too_few_or_central_images_are_refused() -> None:
    _, images, placings, known = captured(3, count=12, placings=1)
    with pytest.raises(RigError, match="10 are needed") as caught:
        lamp_lobe.fit(images[:9], placings, known)
    assert caught.value.code is ErrorCode.CALIBRATION_INFEASIBLE
    _, aimed, placings, known = captured(3, count=12, placings=1, tilt_deg=5.0)
    with pytest.raises(RigError, match="tilt the lamp"):
        lamp_lobe.fit(aimed, placings, known)


def test_lobe_of_plane_that_is_not_matt_is_refused() -> None:
    _, images, placings, known = captured(4, count=12, placings=1)
    random = np.random.default_rng(0)
    uneven = [replace(one, values=one.values * np.exp(0.1 * random.standard_normal(len(one.values)))) for one in images]
    with pytest.raises(RigError, match="matt") as caught:
        lamp_lobe.fit(uneven, placings, known)
    assert caught.value.code is ErrorCode.CALIBRATION_INFEASIBLE


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("noise", [COARSE, FINE], ids=["coarse", "fine"])
def test_covariance_of_fifty_lobes_covers_truth(noise: tuple[float, float]) -> None:
    """Intensity, lobe and sides of fifty LEDs, and the camera's flat field."""
    of_lobe, of_flat_field, unknowns = list[float](), list[float](), list[int]()
    for seed in range(100, 150):
        truth, images, placings, known = captured(seed, noise=noise)
        found = lamp_lobe.fit(images, placings, known)
        unknowns.append(len(found.covariance))
        of_lobe.append(whitened(found, truth))
        of_flat_field.append(squared(found.flat_field - truth.flat_field, found.flat_covariance))
    inside = np.mean(chi2.cdf(of_lobe, unknowns) < 0.95)
    mean = np.sum(of_lobe) / np.sum(unknowns)
    print(
        f"lobe: {inside:.0%} of 50 in their 95 % ellipsoids of {min(unknowns)} to {max(unknowns)} unknowns, {mean:.2f}"
    )
    require_covered("flat field", of_flat_field, 5, most=1.0)
    assert LEAST <= inside <= MOST
    assert abs(mean - 1) < MEAN_OFF * np.sqrt(2 / np.sum(unknowns))
