"""Attempts for one image: those that the camera loses and those that are exposed wrongly count apart."""

from typing import Any

import numpy as np
import pytest

from acquisition.capture import check, take
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.route import Waypoint
from acquisition.models.shot import FrameQuality, ShotKey
from acquisition.models.step import TakeFurther, TakeShot
from acquisition.runner.shots import ShotCapture
from acquisition.session import SessionRecord
from acquisition.session_state import State
from tests.acquisition import scenes

RECIPE = Recipe(retakes=2)
LIGHT = Light(position=(0.0, 0.0, 0.4), axis=(0.0, 0.0, -1.0))
STEP = TakeShot(
    ShotKey(pass_number=0, number=0),
    Waypoint(light=LIGHT, path=[(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)], speeds=[1.0], seconds=1.0),
)


class Exposing(ShotCapture):
    """Exposes by a script: the kinds of what comes, in turn."""

    def __init__(self, script: list[str]) -> None:
        self.script, self.exposures, self.went_to = script, list[float](), list[Waypoint]()
        self._rig: Any = None

    def _announce_retake(self, record: SessionRecord, key: ShotKey, reason: str) -> None:
        pass

    def _require_arm_at_light(self, exposed: take.Exposed, step: TakeShot | TakeFurther) -> None:
        pass

    def _go_to(self, record: SessionRecord, waypoint: Waypoint, stop: Any) -> None:
        self.went_to.append(waypoint)

    @property
    def region(self) -> np.ndarray:
        return np.ones((1, 1), np.bool_)

    @property
    def _calibration(self) -> Calibration:
        return scenes.calibration(8)

    def take_bracket(self) -> None:
        further = TakeFurther(ShotKey(pass_number=0, number=10_000), STEP.key, 0, 0.4, STEP.waypoint)
        self.take_further(SessionRecord("s", RECIPE, State.RUNNING), further, None)  # type: ignore[arg-type]

    def take(self) -> check.Verdict:
        def judge(_: np.ndarray, exposure_s: float) -> check.Verdict:
            quality = FrameQuality(saturated=0.0, bright_level=0.8, accepted=exposure_s < 0.3)
            return check.Verdict(quality, None if quality.accepted else exposure_s / 2)

        record = SessionRecord("s", RECIPE, State.RUNNING)
        return self._expose_until_good(record, STEP, 1.0, judge, None).verdict  # type: ignore[arg-type]


@pytest.fixture
def exposing(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Exposing:
    made = Exposing(list(request.param))

    def expose(_: object, exposure_s: float, attempt: int, **__: object) -> Any:
        made.exposures.append(exposure_s)
        if made.script and made.script.pop(0) == "lost":
            raise RigError(ErrorCode.CAMERA_TIMEOUT, "lost")
        frame: Any = type("Frame", (), {"pixels": np.zeros((1, 1), np.uint16)})
        return take.Exposed(frame, None)  # type: ignore[arg-type]

    monkeypatch.setattr(take, "expose", expose)
    return made


@pytest.mark.parametrize("exposing", [["lost", "lost", "here"], ["here", "lost", "here", "lost"]], indirect=True)
def test_attempts_lost_frames_leave_those_for_exposure(exposing: Exposing) -> None:
    assert exposing.take().quality.accepted
    assert sorted(set(exposing.exposures), reverse=True) == [1.0, 0.5, 0.25]


@pytest.mark.parametrize("exposing", [["dark", "lost", "lost", *["dark"] * 20]], indirect=True)
def test_attempts_further_frame_without_light_is_rejected_after_retakes_whatever_was_lost(exposing: Exposing) -> None:
    with pytest.raises(RigError, match="no light") as raised:
        exposing.take_bracket()
    assert raised.value.code is ErrorCode.CAPTURE_FRAME_REJECTED
    assert exposing.exposures == [0.4] * (1 + RECIPE.retakes + 2)
    assert exposing.went_to == [STEP.waypoint]


@pytest.mark.parametrize("exposing", [["lost"] * 3], indirect=True)
def test_attempts_frames_lost_once_too_often_are_told(exposing: Exposing) -> None:
    with pytest.raises(RigError, match="lost"):
        exposing.take()
    assert len(exposing.exposures) == 1 + RECIPE.retakes
