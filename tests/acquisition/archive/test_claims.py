"""Claims of solves: one owner at a time, gone when not renewed, and one result whoever comes first."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from acquisition.archive import claims
from acquisition.archive.archive import Archive
from acquisition.archive.claims import Claim, SolveKey
from acquisition.archive.entries import ResultEntry, SolveIdentity
from acquisition.models.result import SolveSettings

IDENTITY = SolveIdentity(settings=SolveSettings(depth_rounds=1))


@pytest.fixture
def held(archive: Archive, session_folder: Callable[..., Path]) -> Claim:
    """A claim of a session of the archive, not made yet."""
    return Claim(SolveKey(archive.push(session_folder()).key, "9.0", IDENTITY.hash), owner="one", call="first")


def entry(held: Claim, sigma: float = 1.0) -> ResultEntry:
    return ResultEntry(
        session=held.key.session, solver=held.key.solver, identity=IDENTITY, origin="archive", sigma_deg=sigma,
        solved_at=time.time(), files={},
    )  # fmt: skip


def row(archive: Archive, held: Claim):
    return next(row for row in archive.catalogue.results(held.key.session) if row.solver == "9.0")


def test_claim_held_by_another_is_refused(archive: Archive, held: Claim):
    assert claims.claim(archive.catalogue, held) == "claimed"
    assert claims.claim(archive.catalogue, replace(held, owner="two")) == "elsewhere"


def test_claim_by_the_same_owner_is_repeated(archive: Archive, held: Claim):
    assert [claims.claim(archive.catalogue, held) for _ in range(2)] == ["claimed"] * 2


def test_claim_that_ran_out_is_taken_and_its_result_dropped(
    archive: Archive, held: Claim, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(claims, "LEASE_S", 0.0)
    assert claims.claim(archive.catalogue, held) == "claimed"
    monkeypatch.undo()
    two = replace(held, owner="two")
    assert claims.claim(archive.catalogue, two) == "claimed"
    assert not claims.finish(archive.catalogue, held, entry(held, 5.0), None)
    assert claims.finish(archive.catalogue, two, entry(two, 1.5), (0.1, 0.5))
    found = row(archive, held)
    assert (found.state, found.sigma_deg, found.finishes, found.attempts) == ("done", 1.5, 1, 2)


def test_finished_solve_is_not_claimed_again(archive: Archive, held: Claim):
    claims.claim(archive.catalogue, held)
    claims.finish(archive.catalogue, held, entry(held), None)
    assert claims.claim(archive.catalogue, replace(held, owner="two", call="second")) == "done"
    assert claims.finish(archive.catalogue, held, entry(held), None)  # the same transaction, repeated
    assert row(archive, held).finishes == 1


def test_failed_solve_is_tried_again_by_another_call_only(archive: Archive, held: Claim):
    claims.claim(archive.catalogue, held)
    claims.fail(archive.catalogue, held, "too few lights")
    assert claims.claim(archive.catalogue, replace(held, owner="two")) == "failed"
    assert claims.claim(archive.catalogue, replace(held, owner="two", call="second")) == "claimed"


def test_released_claim_is_free_at_once(archive: Archive, held: Claim):
    claims.claim(archive.catalogue, held)
    claims.release(archive.catalogue, held)
    assert claims.claim(archive.catalogue, replace(held, owner="two")) == "claimed"


def test_renewed_claim_stays_beyond_its_lease(archive: Archive, held: Claim, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(claims, "RENEWAL_S", 0.01)
    monkeypatch.setattr(claims, "LEASE_S", 0.0)
    claims.claim(archive.catalogue, held)
    monkeypatch.setattr(claims, "LEASE_S", 60.0)
    with claims.renewed(archive.catalogue, held):
        deadline = time.monotonic() + 60
        while claims.claim(archive.catalogue, replace(held, owner="two")) == "claimed":
            claims.release(archive.catalogue, replace(held, owner="two"))
            claims.claim(archive.catalogue, held)
            assert time.monotonic() < deadline
    assert claims.claim(archive.catalogue, replace(held, owner="two")) == "elsewhere"


def test_finish_shows_the_newest_solver_with_the_session(archive: Archive, held: Claim):
    claims.claim(archive.catalogue, held)
    claims.finish(archive.catalogue, held, entry(held, 0.7), None)
    (session,) = archive.catalogue.sessions()
    assert (session.solver, session.sigma_deg) == ("9.0", 0.7)
