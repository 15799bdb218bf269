"""Requests of further solves in the journal: events of acceptance, pending until one of success or failure follows."""

import json
from dataclasses import dataclass
from typing import Any

from acquisition.models.event_type import EventType
from acquisition.models.result import SolveSettings
from acquisition.store import Journal

ACCEPTED: EventType = "resolve.accepted"
FAILED: EventType = "resolve.failed"
READY: EventType = "normals.ready"


@dataclass(frozen=True)
class SolveRequest:
    """A requested solve: its number among the session's results, and the last pass whose images it uses."""

    session_id: str
    number: int
    settings: SolveSettings
    last_pass: int
    idempotency_key: str | None = None
    software: str = ""
    calibration: str | None = None

    @property
    def key(self) -> tuple[str, int]:
        """Identifies the request: its session and its number."""
        return self.session_id, self.number


def submitted(journal: Journal, session_id: str | None, *, with_finished: bool = False) -> list[SolveRequest]:
    """Returns the solve requests of one session or of all sessions: those without an outcome, or all of them."""
    asked: dict[tuple[str, int], SolveRequest] = {}
    last = 0
    while events := journal.events(last, 500, session_id, (ACCEPTED, FAILED, READY)):
        last = events[-1].id
        for event in events:
            key = (event.session_id or "", event.body["number"])
            if event.type == ACCEPTED:
                settings = SolveSettings.model_validate_json(json.dumps(event.body["settings"]))
                asked[key] = SolveRequest(
                    *key,
                    settings,
                    event.body["last_pass"],
                    event.body.get("idempotency_key"),
                    event.body.get("software", ""),
                    event.body.get("calibration"),
                )
            elif not with_finished:
                asked.pop(key, None)
    return list(asked.values())


def failures(journal: Journal, session_id: str) -> dict[int, dict[str, Any]]:
    """Returns the problems of a session's failed solves, by number."""
    events = journal.events(0, 10_000, session_id, (FAILED,))
    return {event.body["number"]: event.body["problem"] for event in events}
