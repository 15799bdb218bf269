"""Exposures on the way: when one begins, and where the lamp was during it, on tracks of known motion."""

import numpy as np
import pytest

from acquisition import lamp_pose
from acquisition.capture import moving
from acquisition.devices import TrackPoint
from acquisition.models.shot import FrameQuality, FrameRef, Shot, ShotKey, ShotMotion
from hardware_sim import nominal
from hardware_sim.controller.profile import Trapezoid

PERIOD_S = 0.008
MOVE = Trapezoid(1.0, 0.5, 1.4)
"""The first joint turns by 1 rad under 0.5 rad/s and 1.4 rad/s²; the lamp, 0.5 m away, goes along x."""
ARM_M = 0.5
GOAL = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def point(at: float, delay: float = 0.002) -> TrackPoint:
    """The arm at a time after the move's begin; the controller's clock is 50 s ahead."""
    turned = MOVE.position(at)
    pose = np.eye(4)
    pose[0, 3] = ARM_M * turned
    return TrackPoint(at + 50.0, at + delay, (turned, 0.0, 0.0, 0.0, 0.0, 0.0), pose)


def track(until: float, seconds: float = 0.5, gap: tuple[float, float] = (9.0, 9.0)) -> moving.LampTrack:
    delays = np.random.default_rng(1).uniform(0.002, 0.01, 1000)
    times = np.arange(max(0.0, until - seconds), until + 1e-9, PERIOD_S)
    points = [point(float(t), d) for t, d in zip(times, delays, strict=False) if not gap[0] < t < gap[1]]
    return moving.lamp_track([*points, point(until)], np.eye(4))


def test_is_near_begins_within_the_allowed_distance_of_the_light() -> None:
    allowed_m, lead_s = 5e-4, 0.005
    begun = next(t for t in np.arange(0.2, 3.0, 0.002) if moving.is_near(track(float(t)), GOAL, allowed_m, lead_s))
    left_m = ARM_M * (1.0 - MOVE.position(begun + lead_s))
    assert 0.0 < left_m <= allowed_m
    assert MOVE.duration - 0.06 < begun < MOVE.duration


def test_is_near_arm_that_has_not_begun_is_not_near() -> None:
    still = [TrackPoint(t, t, (0.0,) * 6, np.eye(4)) for t in (0.0, PERIOD_S)]
    assert not moving.is_near(moving.lamp_track(still, np.eye(4)), GOAL, 1e-3, 0.0)
    assert not moving.is_near(moving.lamp_track(still[:1], np.eye(4)), GOAL, 1e-3, 0.0)


@pytest.mark.parametrize("begin", [MOVE.duration - 0.03, 1.0])
def test_during_middle_and_motion_are_those_of_the_true_track(begin: float) -> None:
    end = begin + 0.05
    middle = moving.during(track(begin + 0.2), begin + 0.002, end + 0.002)  # arrival by the least delay, 2 ms
    assert middle is not None
    true = MOVE.position((begin + end) / 2)
    assert middle.joints[0] == pytest.approx(true, abs=2e-5)
    assert middle.base_from_tool[0, 3] == pytest.approx(ARM_M * true, abs=1e-5)
    assert middle.controller_time == pytest.approx(50 + (begin + end) / 2, abs=1e-6)
    moved = ARM_M * (MOVE.position(end + moving.CLOCK_S) - MOVE.position(begin - moving.CLOCK_S))
    assert middle.motion.moved_m == pytest.approx(moved, abs=2e-5)
    places = ARM_M * np.array([MOVE.position(t) for t in np.linspace(begin, end, 200)])
    by_clock = ARM_M * MOVE.speed_at((begin + end) / 2) * moving.CLOCK_S
    assert middle.motion.sigma_m == pytest.approx(
        np.sqrt((np.mean((places - ARM_M * true) ** 2) + by_clock**2) / 3), rel=0.1, abs=5e-6
    )


def test_during_uncovered_or_gapped_track_gives_none() -> None:
    assert moving.during(track(1.0), 0.97, 1.02) is None
    assert moving.during(track(1.0), 0.1, 0.15) is None
    assert moving.during(track(1.2, gap=(0.97, 1.02)), 0.95, 1.03) is None
    assert moving.during(track(1.2, gap=(0.97, 1.0)), 0.95, 1.03) is not None


def test_with_motion_adds_the_mean_variance_of_all_images() -> None:
    calibration = nominal.calibration(64)
    still = Shot(
        key=ShotKey(pass_number=0, number=0), kind="light", frame=FrameRef(path="", width=1, height=1, sha256=""),
        exposure_s=1.0, taken_at=0.0, quality=FrameQuality(saturated=0.0, bright_level=0.0, accepted=True),
    )  # fmt: skip
    moved = still.model_copy(update={"motion": ShotMotion(moved_m=1e-3, sigma_m=4e-4)})
    assert lamp_pose.with_motion(calibration, [still, still]) == calibration
    sigma_m = lamp_pose.with_motion(calibration, [still, moved]).lamp_position_sigma_m
    assert sigma_m == pytest.approx(np.hypot(calibration.lamp_position_sigma_m, 4e-4 / np.sqrt(2)))
