"""Sessions on a cell whose controller has PolyScope X: complete, and resumed after a protective stop by a person."""

import contextlib
import time
from collections.abc import Generator

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.session_state import ENDED, State, Trigger
from tests.acquisition.runner.simulated_rig import (
    Rig,
    acknowledge,
    after_first_image,
    end_what_is_left,
    new,
    reason_of,
    simulated_rig,
    wait_for,
)

pytestmark = pytest.mark.long

SAFETY_NORMAL = 1


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("runner"), "127.0.6.31", "x") as made:
        yield made


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    end_what_is_left(rig)


def test_session_with_planned_lights_completes(rig: Rig) -> None:
    session_id = new(rig, Recipe(pilot_lights=3, planned_lights=1))
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=300.0) is State.COMPLETED
    identity = rig.runner.status().identity
    assert identity is not None
    assert identity.software.startswith("PolyScope X")


def test_session_stop_action_ends_it_at_rest(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert wait_for(rig, session_id, *ENDED) is State.STOPPED


def test_session_resumes_after_protective_stop_unlocked_remotely(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    assert reason_of(rig, session_id)["code"] == ErrorCode.ARM_PROTECTIVE_STOP
    with pytest.raises(RigError) as refused:
        rig.runner.recover("unlock", "b")  # nobody has looked
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    with pytest.raises(RigError) as refused:
        rig.runner.acknowledge("b")
    assert refused.value.code is ErrorCode.SAFETY_STILL_FAULTED
    deadline = time.monotonic() + 60
    while rig.control.state()["safety_mode"] != SAFETY_NORMAL:
        with contextlib.suppress(RigError):  # 409 before 5 s have passed
            rig.runner.recover("unlock", "b")
        assert time.monotonic() < deadline
        time.sleep(0.5)
    acknowledge(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=300.0) is State.COMPLETED
