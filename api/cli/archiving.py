"""The work of `lightpose archive …`: tables for people on the error stream, figures for programs.

The solver, Dask and the exports' libraries take seconds to import. Only the commands that need them import them, after
the user's input has been checked.
"""

import sqlite3
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import ValidationError
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from acquisition.formats.session_files import JOURNAL, refuse_in_session
from acquisition.models.errors import ErrorCode, RigError, wrong_fields
from acquisition.models.listing import first_few
from acquisition.models.result import SolveSettings
from acquisition.store import session_table
from api.cli import archive_report

try:
    from acquisition.archive import where
    from acquisition.archive.archive import Archive
    from acquisition.archive.catalogue import SessionRow
    from acquisition.archive.entries import SolveIdentity
except ModuleNotFoundError as error:
    raise RigError(
        ErrorCode.CONFIG_INVALID, f"{error.name} is not installed: pip install 'lightpose[archive]'"
    ) from error

if TYPE_CHECKING:
    from acquisition.archive.distributed import SolveReport

SHOWN_MOVED = 20
"""Number of sessions in the table of changes; the report has all."""


@dataclass(frozen=True)
class ArchiveSolveOptions:
    """Options of `archive solve`."""

    address: str
    catalogue: str | None
    where: str | None
    scheduler: str | None
    local: int
    settings: Path | None
    report: Path | None


def push(address: str, catalogue: str | None, folders: list[Path]) -> dict[str, Any]:
    """Pushes sessions. A damaged or unfinished session is named, and the others continue."""
    pushed: list[dict[str, Any]] = []
    refused: dict[str, str] = {}
    console = _console()
    corrections = cache(partial(_corrections, console=console))
    with _opened(address, catalogue) as archive, _bar(console) as bar:
        for folder in bar.track(_sessions(folders), description="pushing"):
            try:
                _require_session(folder)
                place = folder.resolve()
                label, notes = corrections(place.parent.parent).get(place.name, (None, None))
                done = archive.push(folder, label, notes)
            except RigError as error:
                if error.code is not ErrorCode.FOLDER_INVALID:
                    raise
                refused[str(folder)] = error.detail
                console.print(f"refused: {error.detail}")
                continue
            pushed.append({"folder": str(folder), **asdict(done)})
    new = sum(bool(item["new"]) for item in pushed)
    console.print(f"{new} new sessions, {len(pushed) - new} already archived, {len(refused)} refused")
    return {"pushed": pushed, "new": new, "refused": refused}


def create(address: str, catalogue: str | None) -> dict[str, Any]:
    """Begins an archive; one that is there stays as it is."""
    new = Archive.absent(address)
    Archive.create(address, catalogue).close()
    _console().print(f"{address} is {'a new archive' if new else 'an archive already: nothing was changed'}")
    return {"address": address, "new": new}


def list_sessions(address: str, catalogue: str | None, condition: str | None, limit: int) -> dict[str, Any]:
    """Lists sessions, newest first."""
    wanted = None if condition is None else where.parse(condition)
    with _opened(address, catalogue) as archive:
        rows = archive.catalogue.sessions(wanted, limit)
    table = Table(
        Column("key", no_wrap=True, min_width=8), Column("captured", no_wrap=True, min_width=16),
        "object", "cell", "kind", "lights", "solver", "σ °",
    )  # fmt: skip
    for row in rows:
        sigma = "" if row.sigma_deg is None else f"{row.sigma_deg:.2f}"
        table.add_row(
            row.key[:12],
            _date(row.captured_at),
            row.object,
            row.cell,
            row.kind,
            str(row.lights),
            row.solver or "",
            sigma,
        )
    _console().print(table)
    return {"sessions": [asdict(row) for row in rows]}


def show(address: str, catalogue: str | None, name: str) -> dict[str, Any]:
    """Shows one session."""
    with _opened(address, catalogue) as archive:
        key = archive.find(name)
        entry = archive.session(key)
        (row,) = archive.catalogue.sessions(where.COLUMNS["key"] == key)
        results = archive.catalogue.results(key)
    console = _console()
    console.print(_facts(row))
    table = Table("solver", "settings", "images", "state", "from", "solved", "σ °", "moved °", "over σ")
    for result in results:
        figures = (result.sigma_deg, result.moved_mean_deg, result.moved_over_sigma)
        images = "all" if result.last_pass is None else f"to pass {result.last_pass}"
        table.add_row(
            result.solver, result.settings, images, result.state, result.origin, _date(result.solved_at),
            *("" if figure is None else f"{figure:.2f}" for figure in figures),
        )  # fmt: skip
    console.print(table)
    files = {path: file.model_dump() for path, file in entry.files.items()}
    return {"session": asdict(row), "results": [asdict(result) for result in results], "files": files}


def verify(address: str, catalogue: str | None) -> dict[str, Any]:
    """Hashes every file of an archive."""
    console = _console()
    with _opened(address, catalogue) as archive, _bar(console) as bar:
        task = bar.add_task("verifying", total=None)
        faults = archive.verify(lambda done, total: bar.update(task, completed=done, total=total))
    for fault in faults:
        console.print(f"{fault.what}: {fault.file}, needed by {first_few(fault.needed_by)}")
    console.print(f"{len(faults)} files missing or damaged" if faults else "no file is missing or damaged")
    return {"faults": [asdict(fault) for fault in faults]}


def solve(request: ArchiveSolveOptions) -> dict[str, Any]:
    """Solves the selected sessions that lack a result of this solver and these settings."""
    captures = where.COLUMNS["kind"] == "capture"
    wanted = captures if request.where is None else captures & where.parse(request.where)
    identity = SolveIdentity(settings=_settings(request.settings))
    if request.report is not None:
        refuse_in_session(request.report, "--report")
        with _writing(request.report):
            request.report.open("a").close()  # before hours of work and not after them
    from acquisition.archive import distributed  # noqa: PLC0415 - imports Dask and the solver

    console = _console()
    with _opened(request.address, request.catalogue) as archive, _bar(console) as bar:
        keys = archive.catalogue.selected_keys(wanted)
        task = bar.add_task("solving", total=len(keys))
        report = distributed.solve(
            archive, keys, identity, scheduler=request.scheduler, workers=request.local,
            progress=lambda done: bar.update(task, completed=done),
            returned=lambda why: console.print(f"tried again until it can be done: {why}"),
        )  # fmt: skip
    _show_report(console, report)
    if request.report is not None:
        with _writing(request.report):
            request.report.write_text(archive_report.page(report), encoding="utf-8")
    return {**asdict(report), "sessions": len(keys), "settings": identity.hash}


def export(
    address: str, catalogue: str | None, name: str, form: Literal["folder", "bagit", "relight"], out: Path
) -> str:
    """Exports one session; returns the folder."""
    from acquisition.archive import exports  # noqa: PLC0415 - imports the exports' libraries

    with _opened(address, catalogue) as archive:
        exports.write(archive, archive.find(name), form, out)
    return str(out)


@contextmanager
def _opened(address: str, catalogue: str | None) -> Generator[Archive]:
    archive = Archive(address, catalogue)
    try:
        yield archive
    finally:
        archive.close()


def _sessions(folders: list[Path]) -> list[Path]:
    """Returns the given session folders, and all completed sessions of a given data folder of a service."""
    found: list[Path] = []
    for folder in folders:
        if (folder / JOURNAL).is_file():
            found += sorted(path.parent for path in (folder / "sessions").glob("*/manifest.json"))
        else:
            found.append(folder)
    return found


def _corrections(data: Path, console: Console) -> dict[str, tuple[str | None, str | None]]:
    """Returns the labels and notes in a data folder that a person has corrected, by session; nothing elsewhere."""
    if not (data / JOURNAL).is_file():
        return {}
    try:
        return session_table.corrections(data / JOURNAL)
    except sqlite3.Error as error:
        console.print(f"{data / JOURNAL} cannot be read, so labels and notes are those of the recipes: {error}")
        return {}


def _require_session(folder: Path) -> None:
    """Refuses a folder that is not a completed session's. Raises RigError folder.invalid."""
    if not folder.is_dir():
        raise RigError(ErrorCode.FOLDER_INVALID, f"{folder}: there is no such folder")
    if not (folder / "manifest.json").is_file():
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{folder}: holds neither a completed session (manifest.json) nor a service's data (rig.db)",
        )


def _settings(file: Path | None) -> SolveSettings:
    if file is None:
        return SolveSettings()
    try:
        return SolveSettings.model_validate_json(file.read_bytes())
    except OSError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"--settings {file}: {error.strerror}") from error
    except ValidationError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"--settings {file}: {wrong_fields(error)}") from error


@contextmanager
def _writing(report: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"--report {report}: {error.strerror}") from error


def _show_report(console: Console, report: "SolveReport") -> None:
    console.print(f"{report.solved} solved, {report.kept} already solved, {report.failed} failed")
    for session, why in sorted(report.failures.items()):
        console.print(f"failed: {session[:12]} {why}")
    if not report.moved:
        return
    table = Table("session", "object", "moved, mean °", "rms over σ", title="Largest changes relative to σ")
    for item in report.moved[:SHOWN_MOVED]:
        table.add_row(item.session[:12], item.object, f"{item.mean_deg:.3f}", f"{item.over_sigma:.2f}")
    console.print(table)
    mean = sum(item.mean_deg for item in report.moved) / len(report.moved)
    beyond = sum(item.over_sigma > 1 for item in report.moved)
    console.print(f"{len(report.moved)} compared: {mean:.3f}° on average, {beyond} moved by more than σ (rms)")


def _facts(row: SessionRow) -> Table:
    table = Table(show_header=False)
    for name, value in asdict(row).items():
        table.add_row(name, _date(value) if name.endswith("_at") else str(value))
    return table


def _date(seconds: float | None) -> str:
    return "" if seconds is None else f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M}"


def _console() -> Console:
    return Console(stderr=True, markup=False, highlight=False)


@contextmanager
def _bar(console: Console) -> Generator[Progress]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        yield bar
