"""The journal of sessions in one SQLite file: each change and the event that announces it are one transaction.

It is the only record from which the next step is derived. Plans, routes and results are files that a row names with
their checksum. A plan may be replaced: the newest row of its number is valid, and a route older than its plan is not.
Moves are journalled before they are made (write-ahead); files are written before they are journalled.
"""

import json
import sqlite3
import time
from pathlib import Path
from typing import Any

from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.event_type import EventType
from acquisition.models.light_plan import LightPlan
from acquisition.models.route import Route
from acquisition.models.shot import Shot, ShotKey
from acquisition.session import PassRecord, SessionRecord
from acquisition.session_state import ENDED, RIG_HOLDING, Actor, State, Trigger, allowed_actions, next_state
from acquisition.store.folder import read_value
from acquisition.store.outbox_table import OutboxTable
from acquisition.store.rows import Action, Artifact, SessionRow
from acquisition.store.session_table import new_session_id

PLAN_REVIEWED: EventType = "plan.reviewed"
MOVE_SENT: EventType = "arm.sent"
"""Types of events that a resumed session reads: approved plans, and the path of the last move."""


class Journal(OutboxTable):
    """Sessions and their work in the database of one data folder; any thread may call any method."""

    # ------------------------------------------------------------------------------------------------------- sessions

    def create_session(
        self, recipe: AnyRecipe, cell: str, fingerprint: str, idempotency_key: str | None = None,
        identity: str | None = None,
    ) -> tuple[SessionRow, bool]:  # fmt: skip
        """Creates a session; returns it and True, or for an idempotency key used before, that session and False.

        `identity` comes from `new_session_id` and names the folder that has been made for it. Raises RigError
        request.invalid for a key that was used for another recipe.
        """
        with self._transaction() as connection:
            known = self.session_of_key(idempotency_key, recipe)
            if known is not None:
                return known, False
            (number,) = connection.execute("SELECT coalesce(max(number), 0) + 1 FROM session").fetchone()
            now = round(time.time(), 6)  # as HTTP states it, so that a filter since this time finds the session
            identity = identity or new_session_id(now)
            connection.execute(
                "INSERT INTO session (id, number, state, recipe, cell, fingerprint, idempotency_key, created_at)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (identity, number, State.CREATED, recipe.model_dump_json(), cell, fingerprint, idempotency_key, now),
            )
            self._event(connection, identity, "session.created", {"state": State.CREATED})
            return self.session(identity), True

    def trigger(
        self, session_id: str, trigger: Trigger, actor: str, reason: dict[str, Any] | None = None,
        *, expected: State | None = None,
    ) -> tuple[State, State]:  # fmt: skip
        """Changes a session's state by the transition table and returns (before, after), all in one transaction.

        `actor` is a person's name, or that of `session_state.Actor.RUNNER` or `SERVICE`. If the state is not the
        `expected` one, nothing changes. Raises RigError session.action_not_allowed, rig.busy (naming the holder),
        session.not_found.
        """
        with self._transaction() as connection:
            row = self.session(session_id)
            if expected is not None and row.state is not expected:
                return row.state, row.state
            target = next_state(row.state, trigger, Actor.of(actor))
            if target is None:
                self._record_action(connection, session_id, trigger, actor, "refused")
                connection.execute("COMMIT")  # the refusal is recorded although the call fails
                connection.execute("BEGIN IMMEDIATE")
                may = ", ".join(allowed_actions(row.state)) or "nothing"
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"A session that is {row.state} does not allow {trigger}; it allows {may}",
                    state=row.state,
                    allowed=[str(action) for action in allowed_actions(row.state)],
                )
            self._record_action(connection, session_id, trigger, actor, str(target))
            if target is row.state:
                return row.state, target
            now = time.time()
            try:
                connection.execute(
                    "UPDATE session SET state = ?, reason = ?, started_at = coalesce(started_at, ?), ended_at = ?"
                    " WHERE id = ?",
                    (
                        target,
                        None if reason is None else json.dumps(reason),
                        now if trigger is Trigger.START else None,
                        now if target in ENDED else None,
                        session_id,
                    ),
                )
            except sqlite3.IntegrityError as error:
                holder = self.holder()
                raise RigError(
                    ErrorCode.RIG_BUSY,
                    f"Session {holder.id if holder else '?'} holds the rig",
                    holder=holder.id if holder else None,
                ) from error
            body: dict[str, Any] = {"from": row.state, "state": target, "by": actor}
            self._event(connection, session_id, "session.state", body | ({"reason": reason} if reason else {}))
            return row.state, target

    def delete_session(self, session_id: str, *, unless_awaiting_archive: bool = False) -> None:
        """Removes a session that does not hold the rig, nor waits for the archive if `unless_awaiting_archive`.

        Raises RigError session.action_not_allowed.
        """
        with self._transaction() as connection:
            row = self.session(session_id)
            if unless_awaiting_archive and self.not_yet_archived([session_id]):
                raise RigError(ErrorCode.SESSION_ACTION_NOT_ALLOWED, "The archive does not have all of the session yet")
            if row.state in RIG_HOLDING:
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"A session that is {row.state} cannot be deleted; stop it first",
                    state=row.state,
                    allowed=[str(action) for action in allowed_actions(row.state)],
                )
            connection.execute("DELETE FROM session WHERE id = ?", (session_id,))
            self._event(connection, session_id, "session.deleted", {"session_id": session_id})

    # ------------------------------------------------------------------------------------------------------- the work

    def add_shot(self, session_id: str, shot: Shot) -> None:
        """Records an accepted frame whose file is already on the disk, with the event that announces it."""
        with self._transaction() as connection:
            connection.execute(
                "INSERT INTO shot (session_id, pass_number, number, kind, body) VALUES (?, ?, ?, ?, ?)",
                (session_id, shot.key.pass_number, shot.key.number, shot.kind, shot.model_dump_json()),
            )
            body = {
                "pass": shot.key.pass_number,
                "number": shot.key.number,
                "kind": shot.kind,
                "exposure_s": shot.exposure_s,
                "light_number": shot.light_number,
                "attempt": shot.attempt,
            }
            self._event(connection, session_id, "shot.captured", body)

    def discard_shots(self, session_id: str, pass_number: int, reason: str) -> None:
        """Removes the entries of all frames of a pass; their files stay until the frames are captured anew."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM shot WHERE session_id = ? AND pass_number = ?", (session_id, pass_number))
            self._event(connection, session_id, "shots.discarded", {"pass": pass_number, "reason": reason})

    def add_artifact(
        self, session_id: str, kind: str, number: int, path: str, sha256: str, body: dict[str, Any], event: EventType
    ) -> None:
        """Records a plan, route or result whose file is already on the disk, with the event that announces it."""
        with self._transaction() as connection:
            self._add_artifact(connection, session_id, kind, number, path, sha256, body, event)

    def require_region_allowed(self, session_id: str) -> SessionRow:
        """Returns the session if a region of interest can still influence its plan.

        Raises RigError session.action_not_allowed if it cannot, session.not_found.
        """
        row = self.session(session_id)
        planned = any(item.number > 0 for item in self.artifacts(session_id, "plan"))
        if row.state not in (State.CREATED, State.PAUSED) or planned:
            raise RigError(
                ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                "A region of interest can be drawn before the start, or while the session is paused and its lights "
                f"are not yet planned; this session is {row.state}{' and its lights are planned' if planned else ''}",
                state=row.state,
                allowed=[str(action) for action in allowed_actions(row.state)],
            )
        return row

    def add_region(self, session_id: str, path: str, sha256: str, body: dict[str, Any], actor: str) -> None:
        """Records a region of interest whose file is already on the disk; the newest one is valid.

        Raises RigError as `require_region_allowed`.
        """
        with self._transaction() as connection:
            row = self.require_region_allowed(session_id)
            self._record_action(connection, session_id, "draw-region", actor, str(row.state))
            number = len(self.artifacts(session_id, "region"))
            self._add_artifact(connection, session_id, "region", number, path, sha256, body, "region.drawn")

    def approve(self, session_id: str, pass_number: int, actor: str) -> None:
        """Records that a person has approved the plan of a pass, or placed its target."""
        with self._transaction() as connection:
            self._event(connection, session_id, PLAN_REVIEWED, {"number": pass_number, "by": actor})

    def replace_plan(
        self, session_id: str, number: int, files: dict[str, tuple[str, str]], body: dict[str, Any], actor: str
    ) -> None:
        """Records a plan with which a person replaces another, and its route; their files are already on the disk.

        `files` gives path and SHA-256 of `plan` and `route`. Raises RigError session.action_not_allowed unless the
        session is paused and nobody has approved the old plan.
        """
        with self._transaction() as connection:
            row = self.session(session_id)
            if row.state is not State.PAUSED or number in self._reviewed(session_id):
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"The plan of pass {number} is no longer waiting for review",
                    state=row.state,
                    allowed=[str(action) for action in allowed_actions(row.state)],
                )
            self._record_action(connection, session_id, "replace-plan", actor, f"pass {number}")
            events: dict[str, EventType] = {"plan": "plan.ready", "route": "waypoints.ready"}
            for kind, event in events.items():
                path, digest = files[kind]
                self._add_artifact(connection, session_id, kind, number, path, digest, body, event)

    def record_move(self, session_id: str, path: list[tuple[float, ...]]) -> None:
        """Records a move before it is made (write-ahead): its path (K, 6), rad, from the present joints to the goal."""
        self.announce(session_id, MOVE_SENT, {"way": path})

    def last_path(self, session_id: str) -> list[tuple[float, ...]]:
        """Returns the path (K, 6), rad, of the last move; empty before the first one."""
        row = self._newest_event(session_id, MOVE_SENT)
        return [] if row is None else [tuple(joints) for joints in row["way"]]

    def artifacts(self, session_id: str, kind: str) -> list[Artifact]:
        """Returns the artefacts of one kind, oldest first."""
        rows = self._all("SELECT * FROM artifact WHERE session_id = ? AND kind = ? ORDER BY id", session_id, kind)
        return [
            Artifact(
                row["id"],
                row["kind"],
                row["number"],
                row["path"],
                row["sha256"],
                json.loads(row["body"]),
                row["created_at"],
            )
            for row in rows
        ]

    def plan_count(self, session_id: str, pass_number: int) -> int:
        """Returns the number of plans that a pass has had; the newest is valid."""
        return sum(item.number == pass_number for item in self.artifacts(session_id, "plan"))

    def shots(self, session_id: str) -> list[Shot]:
        """Returns all frames of a session, in the order of capture."""
        rows = self._all("SELECT body FROM shot WHERE session_id = ? ORDER BY rowid", session_id)
        return [Shot.model_validate_json(row["body"]) for row in rows]

    def record(self, session_id: str, folder: Path) -> SessionRecord:
        """Returns what `session.next_step` reads; plans and routes come from the files that the journal names.

        Raises RigError session.not_found, store.corrupt naming the file that is missing or damaged.
        """
        with self._lock:
            row = self.session(session_id)
            plans = {item.number: item for item in self.artifacts(session_id, "plan")}
            routes = {
                item.number: item.path
                for item in self.artifacts(session_id, "route")
                if item.number in plans and item.id > plans[item.number].id  # an older route leads to other lights
            }
            results = self.artifacts(session_id, "result")
            solved = {item.number for item in results if item.body.get("origin", "session") == "session"}
            solved |= {item.number for item in self.artifacts(session_id, "estimate")}
            shots = self.shots(session_id)
            reviewed = self._reviewed(session_id)
            unverified = self._unverified(session_id)
        passes = tuple(
            PassRecord(
                plan=read_value(LightPlan, folder, plans[number].path),
                route=read_value(Route, folder, routes[number]) if number in routes else None,
                shots={
                    shot.light_number: shot
                    for shot in shots
                    if shot.key.pass_number == number and shot.kind == "light" and shot.light_number is not None
                },
                further=_further(shots, number),
                darks={
                    shot.exposure_s: shot for shot in shots if shot.key.pass_number == number and shot.kind == "dark"
                },
                references=tuple(shot for shot in shots if shot.key.pass_number == number and shot.kind == "reference"),
                repeated=_repeated([shot for shot in shots if shot.key.pass_number == number]),
                solved=number in solved,
                reviewed=number in reviewed,
            )
            for number in sorted(plans)
        )
        references = sum(shot.kind == "reference" for shot in shots)
        return SessionRecord(session_id, row.recipe, row.state, passes, references, unverified)

    # --------------------------------------------------------------------------------------------- actions and safety

    def record_action(self, session_id: str | None, action: str, actor: str, outcome: str) -> None:
        """Records an action with its actor and outcome."""
        with self._transaction() as connection:
            self._record_action(connection, session_id, action, actor, outcome)

    def actions(self, session_id: str) -> list[Action]:
        """Returns the history of a session's actions, oldest first."""
        rows = self._all(
            "SELECT session_id, action, actor, outcome, at FROM action WHERE session_id = ? ORDER BY id", session_id
        )
        return [Action(**dict(row)) for row in rows]

    def record_fault(self, code: str, detail: str) -> None:
        """Records a safety fault that requires acknowledgement."""
        with self._transaction() as connection:
            connection.execute("INSERT INTO safety (code, detail, since) VALUES (?, ?, ?)", (code, detail, time.time()))
            self._event(connection, None, "safety.changed", {"code": code, "detail": detail, "acknowledged": False})

    def acknowledge(self, actor: str) -> None:
        """Marks all recorded faults as acknowledged by `actor`."""
        with self._transaction() as connection:
            connection.execute(
                "UPDATE safety SET acknowledged_by = ?, acknowledged_at = ? WHERE acknowledged_at IS NULL",
                (actor, time.time()),
            )
            self._record_action(connection, None, "acknowledge", actor, "acknowledged")
            self._event(connection, None, "safety.changed", {"acknowledged": True, "by": actor})

    def unacknowledged_faults(self) -> list[dict[str, Any]]:
        """Returns recorded faults without acknowledgement, oldest first."""
        return [dict(row) for row in self._all("SELECT code, detail, since FROM safety WHERE acknowledged_at IS NULL")]

    # ------------------------------------------------------------------------------------------------------ internals

    def _add_artifact(
        self, connection: sqlite3.Connection, session_id: str, kind: str, number: int, path: str, sha256: str,
        body: dict[str, Any], event: EventType,
    ) -> None:  # fmt: skip
        connection.execute(
            "INSERT INTO artifact (session_id, kind, number, path, sha256, body, created_at)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)",
            (session_id, kind, number, path, sha256, json.dumps(body), time.time()),
        )
        self._event(connection, session_id, event, {"number": number, "path": path})

    def _reviewed(self, session_id: str) -> set[int]:
        return {event.body["number"] for event in self.events(0, 10_000, session_id, (PLAN_REVIEWED,))}

    def _unverified(self, session_id: str) -> bool:
        """Returns whether the session was resumed after an interruption and has repeated no image since."""
        (resumed,) = self._all(
            "SELECT max(id) AS id FROM event WHERE session_id = ? AND type = 'session.state'"
            " AND json_extract(body, '$.from') = 'interrupted' AND json_extract(body, '$.state') = 'running'",
            session_id,
        )
        (repeated,) = self._all(
            "SELECT max(id) AS id FROM event WHERE session_id = ? AND type = 'shot.captured'"
            " AND json_extract(body, '$.kind') = 'reference'",
            session_id,
        )
        return resumed["id"] is not None and (repeated["id"] or 0) < resumed["id"]

    def newest(self, type_: str) -> dict[str, Any] | None:
        """Returns the body of the newest event of a type that belongs to no session, or None."""
        row = self._one("SELECT body FROM event WHERE session_id IS NULL AND type = ? ORDER BY id DESC LIMIT 1", type_)
        return None if row is None else json.loads(row["body"])

    def _newest_event(self, session_id: str, type_: str) -> dict[str, Any] | None:
        row = self._one(
            "SELECT body FROM event WHERE session_id = ? AND type = ? ORDER BY id DESC LIMIT 1", session_id, type_
        )
        return None if row is None else json.loads(row["body"])


def _further(shots: list[Shot], number: int) -> dict[int, tuple[Shot, ...]]:
    """Returns the further frames of each light of pass `number`."""
    result: dict[int, tuple[Shot, ...]] = {}
    for shot in shots:
        if shot.key.pass_number == number and shot.kind == "bracket" and shot.light_number is not None:
            result[shot.light_number] = (*result.get(shot.light_number, ()), shot)
    return result


def _repeated(shots: list[Shot]) -> frozenset[ShotKey]:
    """Returns the keys of images repeated after the last lit one of a pass; `shots` are in the order of capture."""
    last_lit = max((place for place, shot in enumerate(shots) if shot.kind == "light"), default=-1)
    return frozenset(shot.repeats for shot in shots[last_lit + 1 :] if shot.repeats is not None)
