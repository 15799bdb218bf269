"""Estimates of calibration sessions: computed and recorded like results, and kept as a set when the session ends."""

import threading
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from acquisition.formats.atomic_write import written_by_job
from acquisition.models import cell_config
from acquisition.models.base import Value
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import CalibrationRecipe, CheckRecipe, LampRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.calibration_set import CalibrationSet
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.event_type import EventType
from acquisition.runner import calibration_checks, results
from acquisition.runner.compute import Compute
from acquisition.runner.rig_choices import camera_name
from acquisition.session import SessionRecord
from acquisition.store import Artifact, Store
from acquisition.store.folder import write_manifest

JOBS = {"camera": "estimate_from_board", "hand-eye": "estimate_from_board", "response": "estimate_response"}
"""Name of the estimating job by kind of session; these jobs have equal parameters. The jobs of the kinds `lamp` and
`check` take the folder of the calibration set in use in place of the flag `last`."""

READY: EventType = "estimate.ready"
"""Type of the event that announces an estimate."""


def estimate_and_record(
    store: Store, compute: Compute, record: SessionRecord, number: int, cell: CellConfig, calibration: Calibration,
    set_folder: Path | None, stop: threading.Event,
) -> None:  # fmt: skip
    """Estimates from all images of a session and records the estimate: files first, then row and event.

    `set_folder` is that of the calibration set in use (None: the cell file's calibration). Raises Halted, and what the
    job raises.
    """
    folder, recipe = store.folder(record.session_id), record.recipe
    if not isinstance(recipe, CalibrationRecipe):
        raise RigError(ErrorCode.SERVICE_FAULT, f"A session of kind {recipe.kind} has no estimate")
    name = f"estimates/{number}"
    images = results.observations(record, folder)
    last = len(images.shots) >= recipe.max_images
    begun = time.monotonic()
    if isinstance(recipe, LampRecipe | CheckRecipe):
        job, given = ("estimate_lamp" if recipe.kind == "lamp" else "estimate_check"), (set_folder, folder / name)
    else:
        job, given = JOBS[recipe.kind], (folder / name, last)
    with written_by_job(folder / name):
        summary: CalibrationSummary = compute.run(stop, job, recipe, cell, calibration, images, *given)
    compute.run(stop, "report_calibration", folder / name, f"Calibration {record.session_id} ({recipe.kind})",
                _made_with(record, cell, calibration, set_folder, summary, folder), summary.advice)  # fmt: skip
    more: dict[str, object] = {"seconds": round(time.monotonic() - begun, 3), "passes": list(range(number + 1))}
    facts = {
        "session_id": record.session_id,
        "number": number,
        **more,
        "software": {"lightpose": version("lightpose")},
        "cell_fingerprint": cell.fingerprint,
        "calibration_before": calibration.fingerprint,
        "summary": _json(summary),
    }
    digest = write_manifest(folder / name, facts)
    body = {**_json(summary), **more}
    store.journal.add_artifact(record.session_id, "estimate", number, f"{name}/manifest.json", digest, body, READY)


def newest(store: Store, session_id: str) -> Artifact | None:
    """Returns the newest estimate of a session, or None."""
    made = store.journal.artifacts(session_id, "estimate")
    return made[-1] if made else None


def summary_of(entry: Artifact) -> CalibrationSummary:
    """Returns the figures of an estimate in the journal."""
    known = CalibrationSummary.model_fields
    return CalibrationSummary.model_validate({name: entry.body[name] for name in known if name in entry.body})


def keep(store: Store, record: SessionRecord, cell: CellConfig, set_folder: Path | None) -> None:
    """Keeps a session's newest estimate as a calibration set named after the session; that of a check in the journal.

    Files of the set in use (folder `set_folder`) that the estimate does not replace are kept with it: they state the
    covariances of the values that it takes over.
    """
    entry, folder = newest(store, record.session_id), store.folder(record.session_id)
    if entry is None or not entry.body["estimated"]:
        return
    estimate = (folder / entry.path).parent
    if isinstance(record.recipe, CheckRecipe):
        calibration_checks.record(store, record.session_id, estimate)
        return
    arm_file = folder / "arm.txt"
    values = cell_config.load_calibration(estimate / "calibration.json")
    shots = results.observations(record, folder).shots
    made = CalibrationSet(
        id=record.session_id,
        kind=record.recipe.kind,
        fingerprint=values.fingerprint,
        before=cell_config.load_calibration(folder / "calibration.json").fingerprint,
        made_at=values.made_at,
        version=version("lightpose"),
        width=values.width,
        height=values.height,
        camera=camera_name(cell),
        arm=_text(arm_file),
        images={shot.frame.path: shot.frame.sha256 for shot in shots},
        summary=summary_of(entry),
    )
    store.calibrations.add(made, estimate, set_folder)
    store.journal.announce(record.session_id, "calibration.made", {"id": made.id, "fingerprint": made.fingerprint})


def _made_with(
    record: SessionRecord, cell: CellConfig, calibration: Calibration, set_folder: Path | None,
    summary: CalibrationSummary, folder: Path,
) -> dict[str, str]:  # fmt: skip
    """Returns what an estimate is based on, for its report."""
    return {
        "session": record.session_id,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": f"lightpose {version('lightpose')}",
        "camera": camera_name(cell),
        "arm": _text(folder / "arm.txt") or cell.arm.model,
        "cell file": f"{cell.name}, SHA-256 {cell.fingerprint}",
        "images": f"{summary.images}, of which {summary.used} were used",
        "previous calibration": (
            f"{'the cell file' if set_folder is None else set_folder.name}, SHA-256 {calibration.fingerprint}"
        ),
        "this calibration": f"SHA-256 {summary.fingerprint}" if summary.fingerprint else "none",
    }


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8") if file.exists() else ""


def _json(value: Value) -> dict[str, object]:
    return value.model_dump(mode="json")
