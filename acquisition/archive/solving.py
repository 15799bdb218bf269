"""One solve of an archived session, on any machine: claim, fetch, solve, store, enter.

It is the same near-light solve as the service's (`runner.session_solve`), on files whose hashes are checked, in a
temporary folder; what stays is content-addressed. The result is stored beside the older ones and compared with the one
before: by how much the normals moved, and whether σ covered that.
"""

import functools
import tempfile
import time
import uuid
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tifffile

from acquisition import photometry
from acquisition.archive import claims
from acquisition.archive.archive import Archive
from acquisition.archive.claims import Claim, SolveKey
from acquisition.archive.entries import FileEntry, ResultEntry, SolveIdentity, result_name
from acquisition.archive.tiling import ArchivedFrames, by_tiles
from acquisition.formats import export
from acquisition.formats.folders import session_folder
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap
from acquisition.runner.session_solve import solve_in_cell
from acquisition.store.folder import sha256_of

PATIENCE_S = 60.0
"""Time, s, for which a worker waits for a database that restarts; beyond it the solve is given back."""
TRANSIENT = (ErrorCode.ARCHIVE_UNREACHABLE, ErrorCode.STORE_DISK_FULL)
"""Problems of the machine, not of the session: the solve is given back and tried again elsewhere."""


@dataclass(frozen=True)
class Tiling:
    """Number of values (pixels × lights) from which a capture is solved in tiles, and approximate pixels of a tile.

    The result does not depend on it. Smaller captures, side by side, keep workers as busy without maps on the network.
    """

    from_values: int = 1 << 30
    pixels: int = 1 << 20


DEFAULT_TILING = Tiling()


@dataclass(frozen=True)
class SolveJob:
    """A wanted solve: addresses of archive and catalogue, session, settings, solver version, call, and tiling."""

    address: str
    catalogue: str
    session: str
    identity: SolveIdentity
    solver: str
    call: str
    tiling: Tiling = DEFAULT_TILING

    @property
    def key(self) -> SolveKey:
        """Its row in the catalogue."""
        return SolveKey(self.session, self.solver, self.identity.hash, self.identity.last_pass)


@dataclass(frozen=True)
class SolveOutcome:
    """Outcome of a job: `done` (now or before), `failed`, `elsewhere` (another has the claim), `returned` (undone)."""

    session: str
    state: Literal["done", "failed", "elsewhere", "returned"]
    detail: str = ""


def solve(job: SolveJob) -> SolveOutcome:
    """Solves one session of an archive unless that is done, failed in the same call, or claimed by another.

    Raises RigError config.invalid when this process has another version of the solver than the caller.
    """
    own = version("lightpose")
    if own != job.solver:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"the worker has lightpose {own}, but the caller has {job.solver}: update one of them",
        )
    try:
        return _claim_and_solve(job)
    except RigError as error:
        if error.code not in TRANSIENT:
            raise
        return SolveOutcome(job.session, "returned", str(error))  # its claim, if it was made, runs out by itself


def _claim_and_solve(job: SolveJob) -> SolveOutcome:
    """Claims and solves one session. Raises RigError archive.unreachable when archive or catalogue do not answer."""
    archive = _opened(job.address, job.catalogue)
    held = Claim(job.key, uuid.uuid4().hex, job.call)
    state = claims.claim(archive.catalogue, held)
    if state != "claimed":
        return SolveOutcome(
            job.session, "elsewhere" if state == "elsewhere" else "failed" if state == "failed" else "done"
        )
    try:
        with (
            claims.renewed(archive.catalogue, held),
            tempfile.TemporaryDirectory(prefix="lightpose-archive-") as scratch,
        ):
            entry, moved = _solve(archive, job, Path(scratch))
            if not claims.finish(archive.catalogue, held, entry, moved):
                return SolveOutcome(job.session, "elsewhere", "the claim ran out during the solve")
    except RigError as error:
        if error.code in TRANSIENT:
            claims.release(archive.catalogue, held)
            return SolveOutcome(job.session, "returned", str(error))
        claims.fail(archive.catalogue, held, str(error))
        return SolveOutcome(job.session, "failed", str(error))
    except OSError as error:
        claims.release(archive.catalogue, held)
        return SolveOutcome(job.session, "returned", f"{type(error).__name__}: {error}")
    return SolveOutcome(job.session, "done")


@functools.cache
def _opened(address: str, catalogue: str) -> Archive:
    """Returns the archive, opened once in each process."""
    return Archive(address, catalogue, patience_s=PATIENCE_S)


def _solve(archive: Archive, job: SolveJob, scratch: Path) -> tuple[ResultEntry, tuple[float, float] | None]:
    """Fetches, solves, stores and compares; returns the result's entry and by how much it moved."""
    session = archive.session(job.session)
    folder = scratch / "session"
    facts = session.facts
    tiled = facts.lights * facts.width * facts.height >= job.tiling.from_values
    # Frames of a capture in tiles are fetched by the process that solves a tile, when it reads them.
    frames = {name: file for name, file in session.files.items() if tiled and fnmatch(name, "passes/*.tiff")}
    archive.fetch({name: file for name, file in session.files.items() if name not in frames}, folder)
    capture = session_folder.read(folder)
    last = job.identity.last_pass
    images = capture.observations(max(shot.key.pass_number for shot in capture.shots) if last is None else last)
    if tiled:
        images = replace(images, frames=ArchivedFrames(job.address, job.session, frames))
    normal_map = solve_in_cell(
        images, capture.cell, capture.calibration, job.identity.settings,
        block_map=by_tiles(job.tiling.pixels) if tiled else map,
    )  # fmt: skip
    name = f"{job.solver}-{job.identity.hash}"
    export.write(normal_map, scratch / "results" / name)
    files = {
        path.relative_to(scratch).as_posix(): FileEntry(sha256=sha256_of(path), bytes=path.stat().st_size)
        for path in sorted((scratch / "results" / name).iterdir())
    }
    archive.put_files(scratch, files)
    entry = ResultEntry(
        session=job.session,
        solver=job.solver,
        identity=job.identity,
        origin="archive",
        sigma_deg=photometry.mean_sigma_deg(normal_map, capture.calibration),
        solved_at=time.time(),
        files=files,
    )
    archive.put_result(entry)
    before = claims.newest_before(archive.catalogue, job.key)
    if before is None:
        return entry, None
    return entry, _moved(archive, archive.result(result_name(job.session, *before)), normal_map, scratch / "before")


def _moved(archive: Archive, before: ResultEntry, after: NormalMap, scratch: Path) -> tuple[float, float] | None:
    """Returns the mean angle, degrees, between two results' normals, and the rms of the angle over the earlier σ.

    Both use the same images, so a sound change stays well below σ, of which the images' noise is a part. None if maps
    are missing, differ in size, or have no pixel in common.
    """
    wanted = {name.rpartition("/")[2]: file for name, file in before.files.items()}
    maps = {name: wanted[name] for name in ("normals.tiff", "sigma_deg.tiff", "mask.png") if name in wanted}
    if len(maps) < 3:
        return None
    archive.fetch(maps, scratch)
    mask = cv2.imread(str(scratch / "mask.png"), cv2.IMREAD_UNCHANGED)
    if mask is None or mask.shape != after.mask.shape:
        return None
    both = (mask > 0) & after.mask
    if not both.any():
        return None
    one = tifffile.imread(scratch / "normals.tiff")[both].astype(np.float64)
    two = after.normals[both].astype(np.float64)
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two), axis=-1), np.sum(one * two, axis=-1)))
    sigma = tifffile.imread(scratch / "sigma_deg.tiff")[both].astype(np.float64)
    known = np.isfinite(sigma) & (sigma > 0)
    ratio = float(np.sqrt(np.mean((angle[known] / sigma[known]) ** 2))) if known.any() else float("nan")
    return float(np.mean(angle)), ratio
