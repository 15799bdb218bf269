"""Rows of the journal's tables as values."""

import json
import sqlite3
from dataclasses import dataclass
from typing import Any

from acquisition.models import calibration_recipe
from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.session_state import State


@dataclass(frozen=True)
class SessionRow:
    """One session in the journal."""

    id: str
    number: int
    state: State
    recipe: AnyRecipe
    cell: str
    fingerprint: str
    reason: dict[str, Any] | None
    created_at: float
    started_at: float | None
    ended_at: float | None
    label: str = ""  # a person's, else the recipe's
    notes: str = ""


@dataclass(frozen=True)
class SessionFilter:
    """Which sessions a list holds; a field that is not given does not restrict it."""

    states: tuple[State, ...] = ()
    label: str = ""  # part of the label, case ignored
    since: float | None = None  # earliest creation, s since 1970
    until: float | None = None  # creation before this, s since 1970


@dataclass(frozen=True)
class Event:
    """One event; ids increase monotonically."""

    id: int
    session_id: str | None
    type: str
    body: dict[str, Any]
    at: float


@dataclass(frozen=True)
class Action:
    """An action, who asked for it, and its outcome."""

    session_id: str | None
    action: str
    actor: str
    outcome: str
    at: float


@dataclass(frozen=True)
class Counts:
    """Numbers of sessions by state, of images and of events."""

    sessions: dict[State, int]
    shots: int
    events: int


@dataclass(frozen=True)
class Artifact:
    """One file or folder that a step produced; ids increase with time."""

    id: int
    kind: str
    number: int
    path: str
    sha256: str
    body: dict[str, Any]
    created_at: float


def session_from_row(row: sqlite3.Row) -> SessionRow:
    """Returns a row of the table `session` as a value."""
    recipe = calibration_recipe.read(row["recipe"])
    return SessionRow(
        id=row["id"],
        number=row["number"],
        state=State(row["state"]),
        recipe=recipe,
        cell=row["cell"],
        fingerprint=row["fingerprint"],
        reason=None if row["reason"] is None else json.loads(row["reason"]),
        created_at=row["created_at"],
        started_at=row["started_at"],
        ended_at=row["ended_at"],
        label=recipe.label if row["label"] is None else row["label"],
        notes=recipe.notes if row["notes"] is None else row["notes"],
    )
