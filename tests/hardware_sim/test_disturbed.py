"""The simulated world with faults of lamp, camera or object."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import nominal
from hardware_sim.controller.disturbances import Disturbances
from hardware_sim.disturbed import DisturbedWorld, nudged
from hardware_sim.world import ExposureInterval, World

CELL = cell_config.load(nominal.default_cell_file())
CALIBRATION = nominal.calibration(48)
LIT = (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423)
ON = [ExposureInterval(1.0, LIT, 1.0)]


def disturbed(seed: int = 1) -> DisturbedWorld:
    return DisturbedWorld(CELL, lambda cell: World(cell, CALIBRATION, "part", 1, "ideal"), seed)


@pytest.fixture(scope="module")
def world() -> DisturbedWorld:
    return disturbed()


def frame(world: DisturbedWorld, **wrong: Any) -> np.ndarray:
    return world.frame(ON, 0.02, 0, asdict(Disturbances(**wrong))).astype(float)


def test_lamp_fault_dims_or_darkens_image(world: DisturbedWorld) -> None:
    full, half, dead = frame(world), frame(world, lamp_fraction=0.5), frame(world, lamp_fraction=0.0)
    dark = world.world.frame([ExposureInterval(1.0, LIT, 0.0)], 0.02, 0)
    assert np.array_equal(dead, dark)
    lit = full > full.min() + 100
    assert lit.any()
    ratio = (half - dark)[lit] / (full - dark)[lit]
    assert ratio == pytest.approx(0.5, abs=0.02)


def test_lamp_flicker_varies_by_exposure_and_repeats_by_run() -> None:
    first, again = disturbed(), disturbed()
    sums = [frame(first, lamp_flicker=0.5).sum() for _ in range(4)]
    assert len(set(sums)) == 4
    assert sums == [frame(again, lamp_flicker=0.5).sum() for _ in range(4)]
    assert max(sums) <= frame(first).sum()


def test_frame_faults_apply_once() -> None:
    world = disturbed()
    good = frame(world)
    with pytest.raises(RigError) as caught:
        frame(world, dropped_frames=1)
    assert caught.value.code is ErrorCode.CAMERA_TIMEOUT
    assert np.array_equal(frame(world, dropped_frames=1), good)
    assert np.all(frame(world, dropped_frames=1, saturated_frames=2) == 4095)
    assert np.all(frame(world, dropped_frames=1, saturated_frames=2) == 4095)
    assert np.array_equal(frame(world, dropped_frames=1, saturated_frames=2), good)


def test_nudged_object_moves_in_image_and_stays() -> None:
    world = disturbed()
    before, mask = frame(world), world.world.truth().mask
    shift = {"object_shift_m": [0.01, 0.0, 0.0]}
    after, moved = frame(world, **shift), world.world.truth().mask
    assert not np.array_equal(after, before)
    # 10 mm at 0.9 m under a focal length of 4600 · 48 / 1024 pixels.
    displacement = np.nonzero(moved)[1].mean() - np.nonzero(mask)[1].mean()
    assert displacement == pytest.approx(0.01 / 0.88 * 4600 * 48 / 1024, abs=0.3)
    assert np.array_equal(frame(world, **shift), after)


def test_nudge_turns_about_object_axis() -> None:
    pose = nudged(CELL, (0.01, 0.02, 0.0), 0.3).object.keep_out.base_from_object.matrix
    assert pose[:3, 3] == pytest.approx((0.56, 0.02, 0.0))
    assert pose[:2, 0] == pytest.approx((np.cos(0.3), np.sin(0.3)))
