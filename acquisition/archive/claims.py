"""Claims of solves in the catalogue: who solves what, for how long, and whether it is done.

A solve is one row, identified by session, solver and settings. A worker claims the row by one conditional statement.
A claim ends by itself when its owner has not renewed it for `LEASE_S`, so that a killed worker or a lost machine blocks
nothing. A result counts only if its owner still holds the claim when it is entered; the result of an owner that was
suspended meanwhile is dropped if another has claimed the solve. So each solve is entered once, whatever fails.
"""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from acquisition.archive.catalogue import Catalogue, make_newest, result
from acquisition.archive.entries import ResultEntry, version_order
from acquisition.models.errors import RigError

LEASE_S = 15.0
"""Time, s, after which another may take a claim that was not renewed: five periods of renewal, because a restart of the
database can delay some renewals."""
RENEWAL_S = 3.0


@dataclass(frozen=True)
class SolveKey:
    """Identity of a solve: session, solver version, hash of the settings, which include the last pass (None: all)."""

    session: str
    solver: str
    settings: str
    last_pass: int | None = None


@dataclass(frozen=True)
class Claim:
    """A claimed solve, who claimed it, and in which call of `archive solve`."""

    key: SolveKey
    owner: str
    call: str


def claim(catalogue: Catalogue, wanted: Claim) -> str:
    """Claims a solve. Returns `claimed`, or why not: `done`, `failed` (in the same call), `elsewhere` (claimed)."""

    def work(connection: sa.Connection) -> str:
        now = catalogue.now()
        row = {
            "session": wanted.key.session,
            "solver": wanted.key.solver,
            "settings": wanted.key.settings,
            "last_pass": wanted.key.last_pass,
            "state": "claimed",
            "origin": "archive",
            "owner": wanted.owner,
            "call": wanted.call,
            "attempts": 1,
        }
        free = sa.or_(
            sa.and_(result.c.state == "claimed", result.c.claimed_until < now),
            sa.and_(result.c.state == "claimed", result.c.owner == wanted.owner),
            sa.and_(result.c.state == "failed", result.c.call != wanted.call),
        )
        statement = catalogue.insert(result).values(row | {"claimed_until": now + LEASE_S})
        changed = {
            "state": "claimed",
            "owner": wanted.owner,
            "call": wanted.call,
            "error": None,
            "claimed_until": now + LEASE_S,
            "attempts": result.c.attempts + 1,
        }
        keys = [result.c.session, result.c.solver, result.c.settings]
        taken = connection.execute(
            statement.on_conflict_do_update(index_elements=keys, set_=changed, where=free).returning(result.c.owner)
        ).first()
        if taken is not None:
            return "claimed"
        state = connection.scalar(sa.select(result.c.state).where(*_of(wanted.key)))
        return str(state) if state in ("done", "failed") else "elsewhere"

    return catalogue.repeatedly(work)


def finish(catalogue: Catalogue, held: Claim, entry: ResultEntry, moved: tuple[float, float] | None) -> bool:
    """Enters the result of a claimed solve; returns False if the claim was lost, so that another's result counts.

    `moved` is the mean angle, degrees, to the normals of the result before, and the rms of the angle over its σ.
    """

    def work(connection: sa.Connection) -> bool:
        changed = {
            "state": "done",
            "claimed_until": None,
            "finishes": result.c.finishes + 1,
            "solved_at": entry.solved_at,
            "sigma_deg": entry.sigma_deg,
            "moved_mean_deg": None if moved is None else moved[0],
            "moved_over_sigma": None if moved is None else moved[1],
            "error": None,
        }
        done = connection.execute(sa.update(result).where(*_held(held)).values(changed))
        if done.rowcount != 1:
            # If a repeated transaction's first answer was lost with the connection, the result is entered, and ours.
            owner = sa.select(result.c.owner).where(*_of(held.key), result.c.state == "done")
            return connection.scalar(owner) == held.owner
        make_newest(connection, entry)
        return True

    return catalogue.repeatedly(work)


def fail(catalogue: Catalogue, held: Claim, why: str) -> None:
    """Records that a claimed solve failed; a later call of `archive solve` may try it again."""
    _update(catalogue, held, {"state": "failed", "claimed_until": None, "error": why})


def release(catalogue: Catalogue, held: Claim) -> None:
    """Gives a claim back when the work could not be done for a reason outside the session."""
    _update(catalogue, held, {"claimed_until": 0.0})


@contextmanager
def renewed(catalogue: Catalogue, held: Claim) -> Generator[None]:
    """Renews a claim in a separate thread while the block runs."""
    ended = threading.Event()

    def renew() -> None:
        while not ended.wait(RENEWAL_S):
            try:
                _update(catalogue, held, {"claimed_until": catalogue.now() + LEASE_S})
            except RigError:
                continue  # the database does not answer: the claim may run out, which `finish` will find

    thread = threading.Thread(target=renew, name="claim", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _update(catalogue: Catalogue, held: Claim, changed: dict[str, Any]) -> None:
    """Changes the row of a claim, if it still is its owner's."""
    statement = sa.update(result).where(*_held(held)).values(changed)
    catalogue.repeatedly(lambda connection: connection.execute(statement).close())


def newest_before(catalogue: Catalogue, key: SolveKey) -> tuple[str, str] | None:
    """Returns solver and settings of the newest other result of the same images whose solver is no newer, or None."""
    same = result.c.last_pass.is_(None) if key.last_pass is None else result.c.last_pass == key.last_pass
    query = sa.select(result.c.solver, result.c.settings, result.c.solved_at).where(
        result.c.session == key.session, result.c.state == "done", same
    )
    rows = catalogue.repeatedly(lambda connection: connection.execute(query).all())
    others = [row for row in rows if (row.solver, row.settings) != (key.solver, key.settings)]
    others = [row for row in others if version_order(row.solver) <= version_order(key.solver)]
    newest = max(others, key=lambda row: (version_order(row.solver), row.solved_at or 0.0), default=None)
    return None if newest is None else (newest.solver, newest.settings)


def _of(key: SolveKey) -> tuple[sa.ColumnElement[bool], ...]:
    return (result.c.session == key.session, result.c.solver == key.solver, result.c.settings == key.settings)


def _held(held: Claim) -> tuple[sa.ColumnElement[bool], ...]:
    return (*_of(held.key), result.c.owner == held.owner, result.c.state == "claimed")
