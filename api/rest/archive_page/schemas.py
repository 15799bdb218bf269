"""Schemas of the archive's answers."""

import math
from datetime import datetime

from pydantic import Field

from acquisition.archive.catalogue import ResultRow, SessionRow
from acquisition.archive.entries import FileEntry
from api.rest.schemas import Links, Resource, as_datetime

ROOT = "/archive/v1/sessions"


class ArchivedSession(Resource):
    """A session in a list of the archive."""

    key: str = Field(description="Hash of its id and files: its identity in the archive")
    session_id: str = Field(description="Its id in the cell that captured it")
    object: str = Field(description="Its label")
    notes: str
    cell: str = Field(description="Name of the cell")
    kind: str = Field(description="Kind of its recipe")
    method: str | None = Field(description="How its lights were chosen; null: a calibration")
    lights: int
    width: int = Field(description="Width of an image, px")
    height: int = Field(description="Height of an image, px")
    bytes: int = Field(description="Size of its files without results")
    captured: datetime | None = Field(description="Time of the first image, UTC")
    pushed: datetime = Field(description="When the archive got it, UTC")
    calibration: str = Field(description="Fingerprint of the calibration in use")
    software: str = Field(description="Version that captured it")
    solver: str | None = Field(description="Version of the newest solver that solved it; null: none has")
    sigma_deg: float | None = Field(description="Mean σ of that solver's result, degrees")
    links: Links

    @classmethod
    def of(cls, row: SessionRow) -> "ArchivedSession":
        """Builds the resource from a row of the catalogue."""
        own = f"{ROOT}/{row.key}"
        return cls(
            key=row.key, session_id=row.session_id, object=row.object, notes=row.notes, cell=row.cell, kind=row.kind,
            method=row.method, lights=row.lights, width=row.width, height=row.height, bytes=row.bytes,
            captured=None if row.captured_at is None else as_datetime(row.captured_at),
            pushed=as_datetime(row.pushed_at), calibration=row.calibration, software=row.software, solver=row.solver,
            sigma_deg=_finite(row.sigma_deg),
            links={"self": own, "picture": f"{own}/picture.jpg", "export": f"{own}/export"},
        )  # fmt: skip


class ArchivedFile(Resource):
    """One file of a session or of a result."""

    path: str
    bytes: int
    sha256: str


class ArchivedResult(Resource):
    """A result: its solver, the images used, its uncertainty, and its change from the result before."""

    solver: str = Field(description="Version of lightpose")
    settings: str = Field(description="Hash of its settings")
    last_pass: int | None = Field(description="Last pass whose images were used; null: all")
    state: str = Field(description="`done`, `claimed` (being solved) or `failed`")
    origin: str = Field(description="`cell`, or `archive` where it was solved again")
    solved: datetime | None = Field(description="When, UTC")
    sigma_deg: float | None = Field(description="Mean σ, degrees")
    moved_mean_deg: float | None = Field(description="Mean angle to the normals of the result before, degrees")
    moved_over_sigma: float | None = Field(description="Rms of that angle over the earlier σ; should be below 1")
    error: str | None = Field(description="Why it failed")
    files: list[ArchivedFile] = Field(description="Its files; none unless it is done")
    links: Links = Field(description="`self`: address of its files, each below it by its name")

    @classmethod
    def of(cls, row: ResultRow, files: dict[str, FileEntry]) -> "ArchivedResult":
        """Builds the resource from a row of the catalogue and the files of its entry."""
        first = next(iter(files), None)
        below = {} if first is None else {"self": f"{ROOT}/{row.session}/files/{first.rpartition('/')[0]}"}
        return cls(
            solver=row.solver, settings=row.settings, last_pass=row.last_pass, state=row.state, origin=row.origin,
            solved=None if row.solved_at is None else as_datetime(row.solved_at), sigma_deg=_finite(row.sigma_deg),
            moved_mean_deg=_finite(row.moved_mean_deg), moved_over_sigma=_finite(row.moved_over_sigma),
            error=row.error, files=listed(files), links=below,
        )  # fmt: skip


class ArchivedSessionDetails(ArchivedSession):
    """A session with its files and results."""

    files: list[ArchivedFile] = Field(description="Its files without results")
    results: list[ArchivedResult] = Field(description="Its results, the oldest first")


def listed(files: dict[str, FileEntry]) -> list[ArchivedFile]:
    """Returns files as resources, by path."""
    return [ArchivedFile(path=path, bytes=file.bytes, sha256=file.sha256) for path, file in sorted(files.items())]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
