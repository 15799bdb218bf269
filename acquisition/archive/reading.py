"""A session's folder as entries of the archive: its files are hashed and checked against the folder's own manifests.

A folder is refused if a file differs from its manifest, because a damaged file must not be handed on as sound. Results
whose folder is not complete (a solve that was killed) are left out, and so are copies of results and the files that
file managers create: they would make another session of the same capture.
"""

import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from acquisition.archive.entries import (
    FileEntry,
    ResultEntry,
    SessionEntry,
    SessionFacts,
    SolveIdentity,
    result_name,
    version_order,
)
from acquisition.formats import session_files
from acquisition.formats.folders.refusal import refusal, text
from acquisition.formats.own_files import LITTER
from acquisition.models import calibration_recipe
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import RigError, in_words
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.store.folder import sha256_of

RESULTS = "results"


def read(folder: Path, label: str | None = None, notes: str | None = None) -> tuple[SessionEntry, list[ResultEntry]]:
    """Reads an ended session's folder as entries; `label` and `notes` are a person's later ones (None: the recipe's).

    Raises RigError folder.invalid naming the file that is missing, damaged or unreadable.
    """
    stated = _manifest(folder)
    with _readable(folder):
        entry = SessionEntry(facts=_facts(folder, stated, label, notes), files=_files(folder, stated))
    results: dict[str, ResultEntry] = {}
    for path in _manifests_of_results(folder):
        with _readable(path.parent):
            result = _result(path.parent, entry, stated)
        results[result.name] = result  # of two with the same settings, the newer one
    return entry, list(results.values())


def result_names(folder: Path, key: str) -> list[str]:
    """Returns the names of the entries that `read` makes of a folder's results, by the session's key; hashes nothing.

    Raises RigError folder.invalid naming the manifest that is missing or unreadable.
    """
    manifests = _manifests_of_results(folder)
    if not manifests:
        return []
    capture = _manifest(folder)
    names: set[str] = set()
    for path in manifests:
        stated = _manifest(path.parent)
        with _readable(path.parent):
            names.add(result_name(key, _solver(stated), _identity(path, stated, capture).hash))
    return sorted(names)


def _manifests_of_results(folder: Path) -> list[Path]:
    """Returns the manifests of a session's results, by number; a result that a person has copied has no number."""
    found = (path for path in (folder / RESULTS).glob("*/manifest.json") if path.parent.name.isdecimal())
    return sorted(found, key=lambda path: int(path.parent.name))


@contextmanager
def _readable(folder: Path) -> Generator[None]:
    """Turns what a manifest lacks or states in another form into RigError folder.invalid."""
    try:
        yield
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise _no_manifest(folder, error) from error


def _facts(folder: Path, stated: dict[str, Any], label: str | None, notes: str | None) -> SessionFacts:
    try:
        recipe = calibration_recipe.read(text(folder / session_files.RECIPE))
        cell = CellConfig.model_validate_json(text(folder / session_files.CELL))
        calibration = Calibration.model_validate_json(text(folder / session_files.CALIBRATION))
    except ValidationError as error:
        raise refusal(folder, f"{error.title} is not readable: {in_words(error.errors()[0])}") from error
    shots: list[dict[str, Any]] = stated["shots"]
    return SessionFacts(
        session_id=str(stated["session_id"]),
        object=recipe.label if label is None else label,
        notes=recipe.notes if notes is None else notes,
        cell=cell.name,
        kind=recipe.kind,
        method=recipe.method if isinstance(recipe, Recipe) else None,
        lights=sum(shot.get("kind") == "light" for shot in shots),
        width=calibration.width,
        height=calibration.height,
        captured_at=min((float(shot["taken_at"]) for shot in shots), default=None),
        calibration=calibration.fingerprint,
        software=str(stated["software"]["lightpose"]),
    )


def _files(folder: Path, stated: dict[str, Any]) -> dict[str, FileEntry]:
    """Hashes every file of a session except its results."""
    found: dict[str, FileEntry] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if not path.is_file() or path.name in LITTER or name.startswith(f"{RESULTS}/") or name.endswith(".part"):
            continue
        if name != os.fsencode(path.relative_to(folder)).decode(errors="replace"):
            raise refusal(folder, f"holds {name!r}, whose name is not UTF-8: rename it, or move it elsewhere")
        found[name] = _checked(path, stated["files"].get(name))
    missing = [name for name in stated["files"] if not name.startswith(f"{RESULTS}/") and name not in found]
    if missing:
        raise refusal(folder / missing[0], "is missing: restore it from a backup")
    return found


def _result(folder: Path, session: SessionEntry, capture: dict[str, Any]) -> ResultEntry:
    stated = _manifest(folder)
    files = {f"{RESULTS}/{folder.name}/{name}": _checked(folder / name, file) for name, file in stated["files"].items()}
    own = folder / "manifest.json"
    files[f"{RESULTS}/{folder.name}/{own.name}"] = _checked(own, None)
    sigma = stated["summary"].get("mean_sigma_deg")
    return ResultEntry(
        session=session.key,
        solver=_solver(stated),
        identity=_identity(own, stated, capture),
        origin="cell",
        sigma_deg=None if sigma is None else float(sigma),
        solved_at=own.stat().st_mtime,
        files=files,
    )


def _solver(stated: dict[str, Any]) -> str:
    return str(stated["software"]["lightpose"])


def _identity(manifest: Path, stated: dict[str, Any], capture: dict[str, Any]) -> SolveIdentity:
    """Returns what a result's manifest states of its solve. Raises RigError folder.invalid."""
    passes: list[int] = stated["passes"]
    last = max((int(shot["key"]["pass_number"]) for shot in capture["shots"]), default=0)
    try:
        settings = SolveSettings.model_validate(stated["settings"])
    except ValidationError as error:
        raise refusal(manifest, f"its settings are not readable: {in_words(error.errors()[0])}") from error
    return SolveIdentity(
        settings=settings,
        last_pass=None if max(passes) >= last else max(passes),
        calibration=stated.get("calibration"),
    )


def _checked(path: Path, stated: dict[str, Any] | None) -> FileEntry:
    """Hashes a file. Raises RigError folder.invalid if it is missing or differs from its manifest."""
    try:
        found = FileEntry(sha256=sha256_of(path), bytes=path.stat().st_size)
    except OSError as error:
        raise refusal(path, "is missing: restore it from a backup") from error
    if stated is not None and found.sha256 != stated["sha256"]:
        raise refusal(path, "is damaged: its SHA-256 differs from that in the manifest; restore it from a backup")
    return found


def _manifest(folder: Path) -> dict[str, Any]:
    """Reads the manifest of a folder. Raises RigError folder.invalid."""
    path = folder / session_files.MANIFEST
    try:
        stated: dict[str, Any] = json.loads(text(path))
        files, software = stated["files"], stated["software"]["lightpose"]
        if not isinstance(files, dict) or not isinstance(software, str):
            raise TypeError("files or software are of another type")
        version_order(software)
    except (ValueError, KeyError, TypeError) as error:
        raise _no_manifest(folder, error) from error
    return stated


def _no_manifest(folder: Path, error: Exception) -> RigError:
    what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return refusal(folder / session_files.MANIFEST, f"is not the manifest of an ended session: {what}")
