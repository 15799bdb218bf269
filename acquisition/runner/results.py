"""Results of a session: the images that they are solved from, the solve of them, and its record."""

import threading
import time
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from acquisition.formats.atomic_write import written_by_job
from acquisition.formats.frames import FolderFrames
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.result import ResultSummary
from acquisition.models.shot import Observations
from acquisition.runner import calibration_checks, solve_calibration
from acquisition.runner.compute import Compute
from acquisition.runner.solve_requests import READY, SolveRequest
from acquisition.session import SessionRecord
from acquisition.store import Store
from acquisition.store.folder import write_manifest


def observations(record: SessionRecord, folder: Path, last_pass: int | None = None) -> Observations:
    """Returns all images so far, or those up to a pass, with the newest lamp-off frame of each exposure time."""
    passes = record.passes if last_pass is None else record.passes[: last_pass + 1]
    shots = (
        shot
        for work in passes
        for shot in (
            *work.shots.values(), *(one for more in work.further.values() for one in more), *work.darks.values(),
            *work.references,
        )
    )  # fmt: skip
    return Observations.of(shots, FolderFrames(folder))


def record_result(
    store: Store, request: SolveRequest, origin: str, summary: ResultSummary, seconds: float, cell: CellConfig
) -> None:
    """Records a result whose files are in its folder: manifest first, then row and event."""
    name = f"results/{request.number}"
    more = {
        "origin": origin,
        "passes": list(range(request.last_pass + 1)),
        "settings": request.settings.model_dump(mode="json"),
        "calibration": request.calibration,
        "seconds": round(seconds, 3),
    }
    facts = {
        "session_id": request.session_id,
        "number": request.number,
        **more,
        "software": {"lightpose": version("lightpose")},
        "cell_fingerprint": cell.fingerprint,
        "convention": "view frame: x right, y up, z to the camera; colours (n + 1) / 2, OpenGL green (+Y)",
        "summary": summary.model_dump(mode="json"),
    }
    digest = write_manifest(store.folder(request.session_id) / name, facts)
    body = {**summary.model_dump(mode="json"), **more}
    store.journal.add_artifact(
        request.session_id, "result", request.number, f"{name}/manifest.json", digest, body, READY
    )


def region_file(store: Store, session_id: str) -> Path | None:
    """Returns the file of the newest mask of the session's region of interest, or None."""
    masks = store.journal.artifacts(session_id, "region")
    return store.folder(session_id) / masks[-1].path if masks else None


def solve_and_record(
    store: Store, compute: Compute, record: SessionRecord, request: SolveRequest, cell: CellConfig,
    calibration: Calibration, stop: threading.Event, *, origin: Literal["session", "resolve"],
) -> None:  # fmt: skip
    """Solves the images of a session up to a pass and records the result; a session's own solve is not preemptible.

    Raises Halted, Preempted, and what the job raises.
    """
    folder = store.folder(request.session_id)
    result = folder / "results" / str(request.number)
    images = observations(record, folder, request.last_pass)
    if request.calibration is not None:
        images = solve_calibration.lit_by(images, cell, calibration)
    begun = time.monotonic()
    with written_by_job(result):
        summary: ResultSummary = compute.run(
            stop, "solve_normals", images, cell, calibration, request.settings, record.passes[request.last_pass].plan,
            region_file(store, request.session_id), result, calibration_checks.state(store, calibration.fingerprint),
            preemptible=origin == "resolve",
        )  # fmt: skip
    record_result(store, request, origin, summary, time.monotonic() - begun, cell)
