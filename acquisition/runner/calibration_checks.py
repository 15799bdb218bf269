"""Checks of the calibration in the journal: an event that belongs to no session and outlives the one that made it."""

from pathlib import Path

from acquisition.models import calibration_check
from acquisition.models.calibration_check import CheckRecord, CheckResult, CheckState
from acquisition.models.event_type import EventType
from acquisition.store import Store

CHECKED: EventType = "calibration.checked"
"""Type of the event that holds the newest check on each target."""


def newest(store: Store) -> dict[str, CheckRecord]:
    """Returns the newest check on each target, of whichever calibration."""
    known = store.journal.newest(CHECKED) or {}
    return {target: CheckRecord.model_validate(body) for target, body in known.items()}


def state(store: Store, fingerprint: str) -> CheckState:
    """Returns the state of the calibration with this fingerprint by the checks."""
    return calibration_check.state(newest(store), fingerprint)


def record(store: Store, session_id: str, estimate: Path) -> None:
    """Enters a session's check, which is in the folder of its `estimate`, into the journal."""
    found = CheckResult.model_validate_json((estimate / "check.json").read_bytes())
    made = CheckRecord(
        session=session_id, made_at=found.made_at, fingerprint=found.fingerprint, passed=found.passed,
        probability=found.probability, changed=tuple(test.name for test in found.changed),
        sentences=tuple(test.sentence for test in found.changed),
    )  # fmt: skip
    known = {**newest(store), found.target: made}
    store.journal.announce(None, CHECKED, {target: one.model_dump(mode="json") for target, one in known.items()})
