"""SIGKILL of the service at a random moment of a session, restart, resume: no lost frame, no motion without a command.

Shards by `LIGHTPOSE_CRASHES=start:stop`, those with several exposures of each light by `LIGHTPOSE_BRACKET_CRASHES`; the
number of a case is its seed. The cases take the stages in turn, and a random moment of the stage.
"""

import random
from collections.abc import Generator

import pytest

from acquisition.models.recipe import Exposure
from acquisition.session_state import State
from tests.crash.crashing import (
    RECIPE,
    Bench,
    announced,
    assert_equal_to_the_undisturbed,
    assert_rests,
    bench,
    cases,
    come_to_rest,
    resume,
    state_of,
)

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[Bench, None, None]:
    with bench(tmp_path_factory.mktemp("killed"), "127.0.14.10") as running:
        yield running


@pytest.fixture(scope="module")
def bracketing(tmp_path_factory: pytest.TempPathFactory) -> Generator[Bench, None, None]:
    """A cell whose sessions take several exposures of each light."""
    recipe = RECIPE.model_copy(update={"exposure": Exposure(plan="planned")})
    with bench(tmp_path_factory.mktemp("bracketing"), "127.0.14.11", recipe=recipe) as running:
        yield running


@pytest.mark.parametrize("case", cases("LIGHTPOSE_BRACKET_CRASHES", 40))
def test_killed_service_session_of_several_exposures_resumes_to_the_same_result(bracketing: Bench, case: int) -> None:
    assert_resumes_to_the_same_result(bracketing, case)


@pytest.mark.parametrize("case", cases("LIGHTPOSE_CRASHES", 200))
def test_killed_service_session_resumes_to_the_same_result(made: Bench, case: int) -> None:
    assert_resumes_to_the_same_result(made, case)


def assert_resumes_to_the_same_result(made: Bench, case: int) -> None:
    """Kills the service at a random moment of stage `case` (they repeat), restarts it, resumes, and compares."""
    chance = random.Random(case)  # noqa: S311 - a test's seed
    number = case % (len(made.stage_begins) - 1)
    with made.serve() as client:
        session_id = made.run_into(client, number, chance)
        made.kill()
    moves, joints = come_to_rest(made)
    kept, was = announced(made.data, session_id), state_of(made.data, session_id)
    with made.serve() as client:
        session = client.session(session_id)
        assert_rests(made)
        state = made.control.state()
        assert state["moves_started"] == moves
        assert state["joints"] == pytest.approx(joints, abs=1e-6)
        if session.state is not State.COMPLETED:  # the last moments of a session may be over when the signal comes
            assert session.state is State.INTERRUPTED
            assert session.reason is not None
            if was is not State.INTERRUPTED:  # else a machine that is too busy has interrupted it before
                assert session.reason.code == "service.restarted"
            session = resume(made, client, session_id)
    assert_equal_to_the_undisturbed(made, session, kept)
