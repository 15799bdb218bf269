"""Comparison of a frame with its repetition, with its prediction, and of its sharpness; on a scene of known shading."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.capture import check, compare, expected
from acquisition.models.shot import FrameQuality
from tests.acquisition import scenes

KNOWN = scenes.calibration(128)
SENSOR = KNOWN.sensor
TRUE = scenes.scene(scenes.bumps, KNOWN)
FIRST, OTHER = scenes.ring(2, 40.0)
REGION = cv2.dilate(TRUE.mask.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
FULL = 2**SENSOR.bits - 1
GOOD = FrameQuality(saturated=0.0, bright_level=0.8, accepted=True)


def frame(
    signal: np.ndarray, seed: int = 0, shift: tuple[float, float] = (0.0, 0.0), brightness: float = 1.0
) -> np.ndarray:
    """What the sensor makes of a signal that is shifted (columns, rows) and exposed to 0.8 of full scale."""
    rng = np.random.default_rng(seed)
    moved = cv2.warpAffine(signal, np.array([[1.0, 0, shift[0]], [0, 1.0, shift[1]]]), signal.shape[::-1])
    level = brightness * 0.8 * SENSOR.full_scale_dn / np.percentile(signal[REGION], 99.5) * moved
    electrons = rng.poisson(level * SENSOR.gain_e_per_dn) + rng.normal(0, SENSOR.read_noise_e, level.shape)
    return np.clip(np.round(SENSOR.black_level_dn + electrons / SENSOR.gain_e_per_dn), 0, FULL).astype(np.uint16)


LIT = scenes.lit(TRUE, FIRST)


def test_same_scene_repeated_image_with_other_noise_is_accepted() -> None:
    same = compare.same_scene(frame(LIT, 1), frame(LIT, 2), REGION, SENSOR)
    assert same.accepted
    assert same.shift_px < 0.1
    assert same.brightness == pytest.approx(1.0, abs=0.01)
    assert same.changed < 0.002


def test_same_scene_lamp_displaced_by_a_millimetre_is_accepted() -> None:
    rng = np.random.default_rng(0)
    for seed in range(6):
        place = np.array(FIRST.position) + 1e-3 * rng.normal(size=3)
        other = FIRST.model_copy(update={"position": tuple(float(value) for value in place)})
        again = frame(scenes.lit(TRUE, other), seed, brightness=1 + 0.014 * rng.normal())
        same = compare.same_scene(frame(LIT, 99), again, REGION, SENSOR)
        assert same.accepted, same.detail


@settings(max_examples=20, deadline=None)
@given(st.floats(-6, 6), st.floats(-6, 6))
def test_shift_known_displacement_is_recovered(across: float, down: float) -> None:
    moved = compare.same_scene(frame(LIT, 1), frame(LIT, 2, (across, down)), REGION, SENSOR)
    far = float(np.hypot(across, down))
    assert moved.shift_px == pytest.approx(far, abs=0.15 + 0.1 * far)
    if far > 0.8:
        assert not moved.accepted
        assert "shifted" in moved.detail


def test_same_scene_changed_brightness_or_content_is_rejected() -> None:
    dim = compare.same_scene(frame(LIT, 1), frame(LIT, 2, brightness=0.7), REGION, SENSOR)
    assert "brightness" in dim.detail
    assert dim.brightness == pytest.approx(0.7, abs=0.02)
    covered = LIT.copy()
    covered[50:75, 50:75] = 0
    other = compare.same_scene(frame(LIT, 1), frame(covered, 2), REGION, SENSOR)
    assert "differs" in other.detail


def test_displacement_predicted_frame_detects_a_shift() -> None:
    known = np.where(TRUE.mask, scenes.lit(TRUE, OTHER), 0.0)
    predicted = expected.decode_image(expected.encode_image(known))
    assert predicted.max() == 65535
    image = frame(scenes.lit(TRUE, OTHER), 3)
    at_rest = expected.displacement(predicted, image, SENSOR.black_level_dn, FULL)
    assert at_rest is not None
    assert not at_rest.moved
    assert at_rest.shift_px < 0.3
    nudged = frame(scenes.lit(TRUE, OTHER), 3, (2.0, -1.5))
    displacement = expected.displacement(predicted, nudged, SENSOR.black_level_dn, FULL)
    assert displacement is not None
    assert displacement.moved
    assert displacement.shift_px == pytest.approx(2.5, abs=0.3)
    verdict = check.compare_with_earlier(GOOD, nudged, REGION, SENSOR, 0.05, [], predicted)
    assert (verdict.usable, verdict.moved, verdict.retake_s) == (False, True, 0.05)
    assert "shifted" in verdict.quality.reason


def test_displacement_image_without_shading_returns_none() -> None:
    flat = np.zeros((128, 128))
    flat[30:90, 30:90] = 1.0
    assert expected.displacement(flat, frame(LIT), SENSOR.black_level_dn, FULL) is None
    assert expected.displacement(np.zeros((128, 128)), frame(LIT), SENSOR.black_level_dn, FULL) is None


def test_sharpness_blurred_frame_is_rejected_under_any_light() -> None:
    usual = [
        check.sharpness(frame(scenes.lit(TRUE, light), n), REGION, SENSOR) for n, light in enumerate((FIRST, OTHER))
    ]
    assert all(sharp is not None for sharp in usual)
    earlier = [sharp for sharp in usual if sharp is not None]
    assert max(earlier) < 2.6 * min(earlier)
    kept = check.compare_with_earlier(GOOD, frame(LIT, 5), REGION, SENSOR, 0.05, earlier, None)
    assert kept.usable
    assert kept.quality.sharpness is not None
    blurred = check.compare_with_earlier(
        GOOD, frame(cv2.GaussianBlur(LIT, (0, 0), 2.0), 5), REGION, SENSOR, 0.05, earlier, None
    )
    assert not blurred.usable
    assert blurred.retake_s == 0.05
    assert "blurred" in blurred.quality.reason


def test_sharpness_frame_without_noise_is_that_of_noisy_ones() -> None:
    """A simulated sensor may have less noise than its model says, which must not be taken from the detail."""
    soft = cv2.GaussianBlur(LIT, (0, 0), 1.5)
    level = 0.8 * SENSOR.full_scale_dn / np.percentile(soft[REGION], 99.5) * soft
    clean = np.round(SENSOR.black_level_dn + level).astype(np.uint16)

    noisy = [check.sharpness(frame(soft, seed), REGION, SENSOR) for seed in range(5)]
    without = check.sharpness(clean, REGION, SENSOR)

    assert without is not None
    assert all(sharp is not None for sharp in noisy)
    assert without == pytest.approx(np.mean([sharp for sharp in noisy if sharp is not None]), rel=0.15)
