"""`lightpose archive …`: options of the commands, whose work is in `archiving`."""

import json
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer

from acquisition.archive import answering
from api.cli.error_exit import explain_errors
from api.cli.summaries import Summaries

app = typer.Typer(
    cls=Summaries,
    no_args_is_help=True,
    help="Sessions of many cells at one address, solved again when the solver improves.",
)


class ExportForm(StrEnum):
    """Form of an exported session."""

    FOLDER = "folder"
    BAGIT = "bagit"
    RELIGHT = "relight"


Address = Annotated[str, typer.Argument(help="A folder, or an address of fsspec such as s3://bucket/archive")]
Where = Annotated[
    str | None,
    typer.Option(help="Only sessions for which this holds, such as \"solver < '0.2' and object ~ 'vase'\""),
]
Name = Annotated[str, typer.Argument(help="The session's key or id, or the beginning of it")]
CatalogueAddress = Annotated[
    str | None,
    typer.Option(
        "--catalogue",
        envvar="LIGHTPOSE_ARCHIVE_CATALOGUE",
        help="postgresql://USER@HOST/NAME, for several cells; default: SQLite in the archive's folder",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object as the last line")]


def _archiving(address: str, catalogue: str | None, scheduler: str | None = None) -> ModuleType:
    """Imports the commands' module once the servers that it needs answer.

    Call it inside `explain_errors`: a server may not answer, and the extra `archive` may be missing.
    """
    answering.require_store(address)
    answering.require_catalogue(catalogue)
    answering.require_scheduler(scheduler)
    from api.cli import archiving

    return archiving


def _print(outcome: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(outcome), flush=True)


@app.command()
def create(address: Address, catalogue: CatalogueAddress = None, as_json: AsJson = False) -> None:
    """Begins an archive in an empty or new folder, or at an unused address; nothing else begins one."""
    _print(explain_errors(lambda: _archiving(address, catalogue).create(address, catalogue)), as_json)


@app.command()
def push(
    address: Address,
    folders: Annotated[list[Path], typer.Argument(help="Folders of completed sessions, or a service's data folder")],
    catalogue: CatalogueAddress = None,
    as_json: AsJson = False,
) -> None:
    """Stores sessions' folders, each file hashed and read back; stored files are not stored again."""
    outcome = explain_errors(lambda: _archiving(address, catalogue).push(address, catalogue, folders))
    _print(outcome, as_json)
    if outcome["refused"]:
        raise typer.Exit(1)


@app.command("list")
def list_sessions(
    address: Address,
    where: Where = None,
    limit: Annotated[int, typer.Option(min=1, help="Maximum number of sessions, newest first")] = 100,
    catalogue: CatalogueAddress = None,
    as_json: AsJson = False,
) -> None:
    """Lists sessions with object, cell, solver and mean σ."""
    _print(
        explain_errors(lambda: _archiving(address, catalogue).list_sessions(address, catalogue, where, limit)), as_json
    )


@app.command()
def show(address: Address, session: Name, catalogue: CatalogueAddress = None, as_json: AsJson = False) -> None:
    """Shows one session: its row of the catalogue, its results, its files."""
    _print(explain_errors(lambda: _archiving(address, catalogue).show(address, catalogue, session)), as_json)


@app.command()
def verify(address: Address, catalogue: CatalogueAddress = None, as_json: AsJson = False) -> None:
    """Hashes every file; names missing and damaged ones (exit status 1) and adds to the catalogue what it lacks."""
    outcome = explain_errors(lambda: _archiving(address, catalogue).verify(address, catalogue))
    _print(outcome, as_json)
    if outcome["faults"]:
        raise typer.Exit(1)


@app.command()
def solve(
    address: Address,
    where: Where = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A Dask scheduler, such as tcp://host:8786, whose workers solve")
    ] = None,
    local: Annotated[int, typer.Option(min=1, help="Without --scheduler: number of processes on this machine")] = 2,
    settings: Annotated[
        Path | None, typer.Option(help="JSON file of settings as in a solve request; default: the solver's own")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="HTML file to write: changes relative to σ, and failures")] = None,
    catalogue: CatalogueAddress = None,
    as_json: AsJson = False,
) -> None:
    """Solves sessions with this version, each only once, whoever asks; older results are kept."""

    def work() -> dict[str, Any]:
        archiving = _archiving(address, catalogue, scheduler)
        return archiving.solve(
            archiving.ArchiveSolveOptions(address, catalogue, where, scheduler, local, settings, report)
        )

    outcome = explain_errors(work)
    _print(outcome, as_json)
    if outcome["failed"]:
        raise typer.Exit(1)


@app.command("export")
def export_session(
    address: Address,
    session: Name,
    out: Annotated[Path, typer.Option(help="A new folder")],
    form: Annotated[
        ExportForm,
        typer.Option(
            "--as",
            help="folder: as `lightpose solve` reads it; bagit: a bag with RO-Crate metadata; relight: "
            "8-bit images and their lights for Relight",
        ),
    ] = ExportForm.FOLDER,
    catalogue: CatalogueAddress = None,
) -> None:
    """Writes one session with its results into a new folder."""
    print(explain_errors(lambda: _archiving(address, catalogue).export(address, catalogue, session, form.value, out)))


@app.command()
def serve(
    address: Address,
    catalogue: CatalogueAddress = None,
    host: Annotated[
        str | None, typer.Option(help="Address to listen at; default: LIGHTPOSE_HOST, else 127.0.0.1; others need keys")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Port to listen at, 0: any free one; default: LIGHTPOSE_PORT, else 8010"),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(help="Folder of the keys (`keys add --data`); default: LIGHTPOSE_DATA, else data"),
    ] = None,
) -> None:
    """Serves the archive's read-only page: /archive."""
    from api.cli import archive_serving

    given = {"archive_catalogue": catalogue, "host": host, "port": port, "data": data}
    wanted = {name: value for name, value in given.items() if value is not None}
    explain_errors(lambda: archive_serving.serve(address, wanted))
