"""A disk that is full before the start or fills up in the middle: refused, survived, resumed.

Shards by `LIGHTPOSE_FULL_DISKS=start:stop`. The data folder is a small file system of its own, so that it is really
full; where this process may not mount one, the cases are skipped.
"""

import os
import random
import time
from collections.abc import Generator
from contextlib import ExitStack

import pytest

from acquisition.models.errors import ErrorCode
from acquisition.session_state import State
from acquisition.store.folder import RESERVED_BYTES
from api import Client, ProblemError
from api.rest.schemas import SessionResource
from tests.crash.crashing import (
    RECIPE,
    Bench,
    announced,
    assert_equal_to_the_undisturbed,
    assert_rests,
    bench,
    cases,
    fill,
    resume,
    small_disk,
)

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[Bench, None, None]:
    folder = tmp_path_factory.mktemp("full")
    with ExitStack() as stack:
        try:
            stack.enter_context(small_disk(folder / "data"))
        except OSError as error:
            pytest.skip(str(error))
        yield stack.enter_context(bench(folder, "127.0.14.30", folder / "data"))


@pytest.mark.parametrize("case", cases("LIGHTPOSE_FULL_DISKS", 10))
def test_session_completes_after_a_full_disk(made: Bench, case: int) -> None:
    chance = random.Random(case)  # noqa: S311 - a test's seed
    number = case % (len(made.stage_begins) - 2)
    with made.serve() as client:
        session_id = made.run_into(client, number, chance)
        filler = fill(made.data, 0 if case % 2 else RESERVED_BYTES // 2)
        try:
            session = until_it_waits(client, session_id)
            assert_rests(made)
        finally:
            os.unlink(filler)
        kept = announced(made.data, session_id)
        if session.state is not State.COMPLETED:
            session = client.wait(session_id)  # a disk without a byte left tells of its pause when there is room again
            assert session.state is State.PAUSED, session
            assert session.reason is not None
            assert session.reason.code is ErrorCode.STORE_DISK_FULL
            session = resume(made, client, session_id)
    assert_equal_to_the_undisturbed(made, session, kept)


def until_it_waits(client: Client, session_id: str) -> SessionResource:
    """The session once it has ended or paused, or has gone no further for a while."""
    deadline = time.monotonic() + 20
    last, since = None, time.monotonic()
    while time.monotonic() < deadline:
        session = client.session(session_id)
        if session.state is not State.RUNNING:
            return session
        if (session.stage, session.progress) != last:
            last, since = (session.stage, session.progress), time.monotonic()
        if time.monotonic() - since > 5:
            return session
        time.sleep(0.1)
    return client.session(session_id)


def test_start_session_larger_than_disk_is_refused_without_motion(made: Bench) -> None:
    with made.serve() as client:
        client.wait_ready()
        session_id = client.create(RECIPE).id
        moves = made.control.state()["moves_started"]
        filler = fill(made.data, RESERVED_BYTES + 1000)
        try:
            with pytest.raises(ProblemError) as refused:
                client.start(session_id)
        finally:
            os.unlink(filler)
        assert refused.value.code is ErrorCode.STORE_DISK_FULL
        assert refused.value.context["free_bytes"] < refused.value.context["needed_bytes"]
        assert client.session(session_id).state is State.CREATED
        assert made.control.state()["moves_started"] == moves
        client.stop(session_id)
