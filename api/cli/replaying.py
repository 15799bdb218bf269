"""`lightpose replay`: solves a session's folder again and compares the normals with its stored result."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from acquisition import photometry
from acquisition.formats import export, folders
from acquisition.formats.folders import session_folder
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from api.cli.solving import progress_bar, shown_step, solve_session, timed

SAME_DEG, SAME_SHARE = 0.01, 0.001
"""Two normal maps count as the same if at most this share of the normals differs by more than this angle, degrees, and
none by more than its σ. Sums differ in the last digit with the order in which threads form them, and a pixel at the
threshold of one of its measurements is then solved otherwise."""


def replay(folder: Path, number: int | None = None) -> dict[str, Any]:
    """Solves a session's images again with the settings of a stored result (default: the last) and compares them.

    Writes nothing. Raises RigError folder.invalid when the folder has no such result or lacks its settings.
    """
    if folders.kind_of(folder) != "session":
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{folder}: is not a session's folder: name one, or solve it with `lightpose solve`",
            file=str(folder),
        )
    capture = session_folder.read(folder)
    chosen = number if number is not None else max(capture.results, default=-1)
    if chosen not in capture.results:
        have = ", ".join(str(one) for one in capture.results) or "none"
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{folder}: has no result {chosen}; it has {have}: name one with --result",
            file=str(folder),
        )
    stored = export.read(folder / "results" / str(chosen))
    settings = _settings_of(folder / "results" / str(chosen) / session_folder.MANIFEST)
    console = Console(stderr=True, markup=False)
    seconds: dict[str, float] = {}
    with progress_bar(console) as bar, timed(seconds, "solve"), shown_step(bar, "solving"):
        normal_map = solve_session(capture, len(stored.flags), settings)
    outcome = _compared(stored, normal_map, capture.calibration) | {
        "result": chosen,
        "images": len(normal_map.flags),
        "seconds": seconds["solve"],
    }
    table = Table(title=f"Result {chosen} of {folder.name}, solved again")
    for column in ("", "stored", "again"):
        table.add_column(column, justify="right" if column else "left")
    table.add_row("normals", str(np.count_nonzero(stored.mask)), str(np.count_nonzero(normal_map.mask)))
    table.add_row("mean σ", *(f"{outcome[name]:.3f}°" for name in ("sigma_before_deg", "sigma_deg")))
    console.print(table)
    verdict = "the same" if outcome["same"] else "different"
    console.print(
        f"The normals are {verdict}: mean {outcome['mean_deg']:.4f}°, 95 % {outcome['p95_deg']:.4f}°, "
        f"largest {outcome['max_deg']:.4f}°."
    )
    return outcome


def _settings_of(manifest: Path) -> SolveSettings:
    """Returns the settings of a stored result; without a manifest the default settings of sessions."""
    if not manifest.exists():
        return SolveSettings()
    try:
        return SolveSettings.model_validate(json.loads(manifest.read_bytes())["settings"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RigError(
            ErrorCode.FOLDER_INVALID, f"{manifest}: has no readable settings of the solve: {error}; restore the file",
            file=str(manifest),
        ) from error  # fmt: skip


def _compared(before: NormalMap, after: NormalMap, calibration: Calibration) -> dict[str, Any]:
    """Compares two results of the same images: angles in degrees over the pixels of both; σ as in the summary."""
    both = before.mask & after.mask
    one, two = before.normals[both].astype(np.float64), after.normals[both].astype(np.float64)
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two), axis=-1), np.sum(one * two, axis=-1)))
    same = (
        np.array_equal(before.mask, after.mask)
        and angle.size > 0
        and np.mean(angle > SAME_DEG) <= SAME_SHARE
        and not np.any(angle > np.maximum(before.sigma_deg[both], SAME_DEG))
    )
    if not angle.size:
        angle = np.array([np.inf])
    return {
        "same": bool(same),
        "mean_deg": float(np.mean(angle)),
        "p95_deg": float(np.percentile(angle, 95)),
        "max_deg": float(np.max(angle)),
        "pixels": int(np.count_nonzero(both)),
        "pixels_before": int(np.count_nonzero(before.mask)),
        "pixels_after": int(np.count_nonzero(after.mask)),
        "sigma_before_deg": photometry.mean_sigma_deg(before, calibration),
        "sigma_deg": photometry.mean_sigma_deg(after, calibration),
    }
