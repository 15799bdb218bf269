"""Exposure control and the quality check of frames."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.capture import check, exposure, region
from acquisition.models import cell_config
from acquisition.models.recipe import Exposure

CELLS = Path(__file__).parents[3] / "hardware_sim" / "cells"
CELL = cell_config.load(CELLS / "cell.sim.toml")
CALIBRATION = cell_config.load_calibration(CELLS / "calibration.sim.json")
SENSOR, CAMERA, WANTED = CALIBRATION.sensor, CELL.camera, Exposure()
REGION = np.ones((40, 50), np.bool_)


def frame(level: float) -> np.ndarray:
    """A frame with a tenth of its pixels at `level` of full scale, the rest at a tenth of it."""
    values = np.full(REGION.shape, SENSOR.black_level_dn + 0.1 * level * SENSOR.full_scale_dn)
    values[:4] = SENSOR.black_level_dn + level * SENSOR.full_scale_dn
    return np.clip(np.round(values), 0, 4095).astype(np.uint16)


def judge(pixels: np.ndarray, exposure_s: float = 0.05, wanted: Exposure = WANTED) -> check.Verdict:
    return check.lit_frame(pixels, REGION, SENSOR, exposure_s, wanted, CAMERA)


@given(st.floats(1e-3, 1e4), st.floats(0.1, 0.9))
def test_for_level_exposure_is_within_a_step_below_the_target(level: float, target: float) -> None:
    chosen = exposure.for_level(level, Exposure(target=target), CAMERA)
    assert CAMERA.min_exposure_s <= chosen <= CAMERA.max_exposure_s
    if CAMERA.min_exposure_s < chosen < CAMERA.max_exposure_s:
        assert target / exposure.STEP * 0.99 < chosen * level < target * 1.01


@given(st.floats(1e-3, 1e4), st.floats(0.1, 0.95))
def test_for_predicted_level_exposure_is_nearest_to_the_target(level: float, target: float) -> None:
    chosen = exposure.for_predicted_level(level, Exposure(target=target), CAMERA)
    assert chosen >= exposure.for_level(level, Exposure(target=target), CAMERA)
    if CAMERA.min_exposure_s < chosen < CAMERA.max_exposure_s:
        assert chosen * level < 1.01 * max(target, exposure.MAX_PREDICTED_LEVEL)
        assert (
            0.99 * min(target, exposure.MAX_PREDICTED_LEVEL / exposure.STEP**0.5) < chosen * level * exposure.STEP**0.5
        )
        assert chosen * level < 1.01 * target * exposure.STEP**0.5


def test_for_level_fixed_exposure_is_returned() -> None:
    assert exposure.for_level(123.0, Exposure(seconds=0.02), CAMERA) == 0.02
    assert exposure.for_predicted_level(123.0, Exposure(seconds=0.02), CAMERA) == 0.02


def test_lit_frame_wrong_exposure_is_corrected_in_one_retake() -> None:
    assert judge(frame(0.8)).retake_s is None
    assert judge(frame(0.8)).quality.bright_level == pytest.approx(0.8, abs=1e-3)
    dark = judge(frame(0.1))
    assert dark.usable
    assert dark.retake_s is not None
    assert judge(frame(0.1 * dark.retake_s / 0.05), dark.retake_s).quality.accepted
    burnt = judge(frame(1.5))
    assert burnt.retake_s is not None
    assert burnt.retake_s < 0.05
    assert not burnt.quality.accepted


def test_lit_frame_without_light_is_unusable() -> None:
    verdict = judge(frame(0.0), CAMERA.max_exposure_s)
    assert not verdict.usable
    assert verdict.retake_s is None
    assert "lamp" in verdict.quality.reason
    assert not judge(frame(0.0), 0.05, Exposure(seconds=0.05)).usable


def test_lit_frame_fully_saturated_is_unusable() -> None:
    white = np.full(REGION.shape, 4095, np.uint16)
    again = judge(white, 0.05)
    assert not again.usable
    assert again.retake_s is not None
    for last in (judge(white, CAMERA.min_exposure_s), judge(white, 0.05, Exposure(seconds=0.05))):
        assert not last.usable
        assert last.retake_s is None
        assert "saturated" in last.quality.reason
    assert judge(frame(1.5), 0.05, Exposure(seconds=0.05)).quality.accepted


def test_dark_frame_bright_room_is_rejected() -> None:
    assert check.dark_frame(frame(0.05), REGION, SENSOR).accepted
    assert "darken" in check.dark_frame(frame(0.6), REGION, SENSOR).reason


def test_keep_out_region_contains_the_projected_cylinder() -> None:
    mask = region.keep_out(CELL, CALIBRATION)
    rows, columns = np.nonzero(mask)
    focal, radius, height = 4600.0, CELL.object.keep_out.radius_m, CELL.object.keep_out.height_m
    by_pinhole = radius * focal / (0.9 - height)
    assert (columns.max() - columns.min()) / 2 == pytest.approx(by_pinhole, rel=0.02)
    assert (rows.max() + rows.min()) / 2 == pytest.approx(511.5, abs=3)
    assert region.middle_depth_m(CELL, CALIBRATION) == pytest.approx(0.9 - height / 2)
