"""Attempts for one image: those that the camera loses and those that are exposed wrongly count apart."""

from typing import Any

import numpy as np
import pytest

from acquisition.capture import check, take
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.route import Waypoint
from acquisition.models.shot import FrameQuality, ShotKey
from acquisition.models.step import TakeShot
from acquisition.runner.shots import ShotCapture
from acquisition.session import SessionRecord, State

RECIPE = Recipe(retakes=2)
LIGHT = Light(position=(0.0, 0.0, 0.4), axis=(0.0, 0.0, -1.0))
STEP = TakeShot(
    ShotKey(pass_number=0, number=0),
    Waypoint(light=LIGHT, path=[(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)], speeds=[1.0], seconds=1.0),
)


class Exposing(ShotCapture):
    """Exposes by a script: the kinds of what comes, in turn."""

    def __init__(self, script: list[str]) -> None:
        self.script, self.exposures = script, list[float]()
        self._rig: Any = None

    def _announce_retake(self, record: SessionRecord, key: ShotKey, reason: str) -> None:
        pass

    def _require_arm_at_light(self, exposed: take.Exposed, light: ShotKey, waypoint: Waypoint) -> None:
        pass

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
        frame: Any = type("Frame", (), {"pixels": np.zeros((1, 1))})
        return take.Exposed(frame, None)  # type: ignore[arg-type]

    monkeypatch.setattr(take, "expose", expose)
    return made


@pytest.mark.parametrize("exposing", [["lost", "lost", "here"], ["here", "lost", "here", "lost"]], indirect=True)
def test_attempts_lost_frames_leave_those_for_exposure(exposing: Exposing) -> None:
    assert exposing.take().quality.accepted
    assert sorted(set(exposing.exposures), reverse=True) == [1.0, 0.5, 0.25]


@pytest.mark.parametrize("exposing", [["lost"] * 3], indirect=True)
def test_attempts_frames_lost_once_too_often_are_told(exposing: Exposing) -> None:
    with pytest.raises(RigError, match="lost"):
        exposing.take()
    assert len(exposing.exposures) == 1 + RECIPE.retakes
