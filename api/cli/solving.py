"""`lightpose solve`: solves folders of images without a service, a cell or a journal.

The input is validated before anything is solved. The output is written to a hidden folder that is renamed at the end.
Progress goes to the error stream for people; programs read one JSON object, the last line of the output.
"""

import json
import tempfile
import time
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from acquisition import photometry
from acquisition.formats import export, folders, report
from acquisition.formats.atomic_write import refused_if_unwritable
from acquisition.formats.folders import Sphere, session_folder
from acquisition.formats.folders.angular_error import AngularErrors, angular_errors
from acquisition.formats.folders.session_folder import SessionCapture
from acquisition.formats.session_files import refuse_in_session
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.rounding import figure, percent
from acquisition.normals import distant, near_light
from acquisition.normals.images.image_set import DistantLights, ImageSet
from acquisition.runner.session_solve import solve_in_cell

SUMMARY = "summary.json"
WRITERS = 2
GONE_SOLVERS = ("weighted", "thresholded", "robust", "glossy")


@dataclass(frozen=True)
class FolderSolveOptions:
    """Options of one solve; `exports` are names of `export.FILES` and `export.FOLDERS`."""

    folder: Path
    solver: distant.Solver = "auto"
    near: bool = False
    out: Path | None = None
    sphere: Sphere | None = None
    exports: tuple[str, ...] = ()
    keep_steps: bool = False
    full_scale: float | None = None


@dataclass(frozen=True)
class Solved:
    """A normal map, the images it was solved from, the solver, the reason for its choice, and the mean σ, degrees."""

    normal_map: NormalMap
    images: ImageSet
    solver: str
    why: str
    sigma_mean_deg: float | None
    """Mean σ of a session over the facing pixels, as in its summary; of others over all solved pixels; or None."""

    @cached_property
    def source(self) -> export.Source:
        """Input of the exports and the report."""
        return export.Source(self.normal_map, self.images)


def solve_request(
    folder: Path, solver: str, near: bool, out: Path | None, sphere: str | None, exports: Sequence[str],
    keep_steps: bool = False, full_scale: float | None = None,
) -> FolderSolveOptions:  # fmt: skip
    """Parses the options: `sphere` as `cx,cy,r`, `exports` by name or `all`. Raises RigError request.invalid."""
    known = tuple(export.FILES | export.FOLDERS)
    unknown = set(exports) - {*known, "all"}
    if unknown:
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"--export {', '.join(sorted(unknown))}: choose from {', '.join(known)}, all"
        )
    if solver in GONE_SOLVERS:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--solver {solver} no longer exists: auto finds shadows, gloss and unequal lamps; leave the option out",
        )
    if solver not in get_args(distant.Solver):
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"--solver {solver}: choose from {', '.join(get_args(distant.Solver))}"
        )
    chosen = known if "all" in exports else tuple(name for name in known if name in exports)
    ball = None if sphere is None else _sphere(sphere)
    refuse_full_scale(full_scale)
    return FolderSolveOptions(folder, cast(distant.Solver, solver), near, out, ball, chosen, keep_steps, full_scale)


def refuse_full_scale(full_scale: float | None) -> None:
    """Refuses a full scale that is not a positive number. Raises RigError request.invalid."""
    if full_scale is not None and not (np.isfinite(full_scale) and full_scale > 0):
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"--full-scale {full_scale:g}: give the greatest stored value, such as 4095"
        )


def _sphere(text: str) -> Sphere:
    try:
        column, row, radius = (float(part) for part in text.split(","))
    except ValueError as error:
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"--sphere {text}: give cx,cy,r in pixels, such as 320,240,180"
        ) from error
    if not (np.isfinite([column, row, radius]).all() and radius > 0):
        raise RigError(ErrorCode.REQUEST_INVALID, f"--sphere {text}: the radius must be positive")
    return Sphere(column, row, radius)


def run(request: FolderSolveOptions) -> dict[str, Any]:
    """Reads, solves, grades and writes one folder; prints a table for people and returns the figures for programs."""
    started = time.monotonic()
    _refuse(request)
    seconds: dict[str, float] = {}
    console = Console(stderr=True, markup=False)
    with progress_bar(console) as bar, _scratch(request.out) as scratch:
        solved = _solved(request, scratch, bar, seconds)
        graded = angular_errors(solved.normal_map, solved.images)
        if request.out is not None:
            with timed(seconds, "write"), shown_step(bar, "writing"):
                _write(request, solved, graded, seconds, request.out)
    outcome = _outcome(request, solved, graded, seconds, time.monotonic() - started)
    _show(console, outcome, report.quality_warnings(solved.normal_map, _facts(request, solved, graded, seconds)))
    return outcome


# ------------------------------------------------------------------------------------------------------------- solving


def _solved(request: FolderSolveOptions, scratch: Path, bar: Progress, seconds: dict[str, float]) -> Solved:
    kind = folders.kind_of(request.folder)
    if kind == "session":
        if request.full_scale is not None:
            raise session_full_scale(request.folder)
        if request.sphere is not None:
            raise RigError(
                ErrorCode.REQUEST_INVALID,
                f"--sphere: {request.folder} is a session, whose normals are not compared with a truth: leave it out",
            )
        with timed(seconds, "read"):
            capture = session_folder.read(request.folder)
        with timed(seconds, "solve"), shown_step(bar, "solving"):
            normal_map = solve_session(capture, None, _settings(request))
        last = len(capture.plans) - 1
        images = session_folder.images(capture.observations(last), capture.calibration, normal_map.silhouette)
        sigma_deg = photometry.mean_sigma_deg(normal_map, capture.calibration)
        return Solved(normal_map, images, *_solver_and_reason(normal_map, request.solver), sigma_deg)
    with timed(seconds, "read"):
        task = bar.add_task("reading", total=None)
        images = folders.read(
            request.folder,
            scratch,
            sphere=request.sphere,
            full_scale=request.full_scale,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    distant_lights = isinstance(images.lights, DistantLights)
    if request.near and distant_lights:
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{request.folder}: gives directions of lights, but --near needs positions: a folder with lights.json",
            file=str(request.folder),
        )
    with timed(seconds, "solve"), shown_step(bar, "solving"):
        if distant_lights:
            normal_map = distant.solve(images, request.solver, keep_steps=request.keep_steps)
        else:
            normal_map = near_light.solve(images, _settings(request))
    sigma = normal_map.sigma_deg[normal_map.mask & np.isfinite(normal_map.sigma_deg)]
    return Solved(
        normal_map,
        images,
        *_solver_and_reason(normal_map, request.solver),
        float(np.mean(sigma)) if sigma.size else None,
    )


def session_full_scale(folder: Path) -> RigError:
    """Returns the refusal of a full scale for a session, whose calibration states it."""
    return RigError(
        ErrorCode.REQUEST_INVALID, f"--full-scale: {folder} is a session, which states it: leave the option out"
    )


def solve_session(capture: SessionCapture, count: int | None, settings: SolveSettings) -> NormalMap:
    """Solves a session's images as the session did; `count`, the number of images, determines the passes used."""
    passes = range(len(capture.plans))
    last = next((one for one in passes if len(capture.observations(one).shots) == count), passes[-1])
    return solve_in_cell(capture.observations(last), capture.cell, capture.calibration, settings)


def _settings(request: FolderSolveOptions) -> SolveSettings:
    """Returns the settings of the near-light solver; `ls` switches off its robust weights and its shadow test."""
    if request.solver == "ls":
        return SolveSettings(robust=False, shadow_threshold=0.0, keep_steps=request.keep_steps)
    return SolveSettings(keep_steps=request.keep_steps)


def _solver_and_reason(normal_map: NormalMap, requested: str) -> tuple[str, str]:
    """Returns the solver used and the reason: from its notes, or the shares of indirect light and gloss."""
    notes = normal_map.notes
    if "why" in notes:
        return str(notes["solver"]), str(notes["why"])
    indirect, lobe = notes.get("interreflection", {}), notes.get("lobe", {})
    light = "distant" if "solver" in notes else "near"
    share = percent(indirect.get("share", 0))
    gloss = figure(lobe.get("strength", 0), 2)
    why = f"{light} light; share of indirect light {share}, gloss {gloss}"
    return (light if requested == "auto" else requested), why


# ------------------------------------------------------------------------------------------------------------- writing


def _refuse(request: FolderSolveOptions) -> None:
    """Refuses outputs that cannot be written, before anything is read. Raises RigError."""
    if request.out is None:
        if request.exports:
            raise RigError(ErrorCode.REQUEST_INVALID, "--export writes files: name a folder with --out")
        return
    out, capture = request.out.resolve(), request.folder.resolve()
    if capture.is_relative_to(out):
        what = "is the capture itself" if capture == out else f"holds the capture {request.folder}"
        raise RigError(
            ErrorCode.FOLDER_INVALID, f"{request.out}: {what}, which would be deleted: name another folder",
            file=str(request.out),
        )  # fmt: skip
    if Path.cwd().is_relative_to(out):
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"--out {request.out}: is the folder in which this command runs, and would be replaced as a whole: name a "
            "folder below it, or run the command elsewhere",
            file=str(request.out),
        )
    refuse_in_session(request.out, "--out")
    export.refuse_foreign(request.out, SUMMARY)


def _write(
    request: FolderSolveOptions, solved: Solved, graded: AngularErrors | None, seconds: dict[str, float], out: Path
) -> None:
    with refused_if_unwritable(out), export.atomic_folder(out.resolve()) as partial:
        with ThreadPoolExecutor(WRITERS) as pool:
            work = [
                pool.submit(export.write_maps, solved.normal_map, partial),
                pool.submit(report.write, solved.normal_map, _facts(request, solved, graded, seconds), partial),
                *(pool.submit(export.make, name, solved.source, partial) for name in request.exports),
            ]
            for future in work:
                future.result()
        summary = _outcome(request, solved, graded, seconds, sum(seconds.values()))
        summary |= {"files": export.checksums(partial)}
        (partial / SUMMARY).write_text(json.dumps(summary, indent=2), encoding="utf-8")
        export.refuse_foreign(out, SUMMARY)  # again, because a file may have appeared there during the solve


def _facts(
    request: FolderSolveOptions, solved: Solved, graded: AngularErrors | None, seconds: dict[str, float]
) -> report.ReportContext:
    images = solved.images
    error = {} if graded is None else {"mean": graded.mean_deg, "median": graded.median_deg, "95 %": graded.p95_deg}
    return report.ReportContext(
        title=request.folder.resolve().name,
        names=images.names,
        directions=solved.source.directions,
        solver=solved.solver,
        why=solved.why,
        seconds=dict(seconds),
        error_deg=error,
        intensities={"session": "calibrated", ".lp": "assumed"}.get(images.notes["format"], "stated"),
        warnings=tuple(images.notes.get("warnings", ())),
    )


def _outcome(
    request: FolderSolveOptions, solved: Solved, graded: AngularErrors | None, seconds: dict[str, float], total: float
) -> dict[str, Any]:
    """Returns the figures of `--json`. Errors are null where no truth is known."""
    nothing: dict[str, Any] = dict.fromkeys(field.name for field in fields(AngularErrors))
    errors = nothing if graded is None else asdict(graded)
    return {
        **errors,
        "seconds": round(total, 3),
        "solver": solved.solver,
        "why": solved.why,
        "folder": str(request.folder),
        "format": solved.images.notes["format"],
        "images": solved.images.count,
        "normals": int(np.count_nonzero(solved.normal_map.mask)),
        "sigma_mean_deg": solved.sigma_mean_deg,
        "depth_unit": export.depth_unit(solved.normal_map),
        "fit": None if solved.normal_map.fit is None else solved.normal_map.fit.model_dump(),
        "findings": [finding.model_dump() for finding in solved.normal_map.findings],
        "intensity_factors": [round(float(factor), 4) for factor in solved.normal_map.intensity_factors],
        "mask": solved.normal_map.notes.get("mask", "given" if solved.images.mask_given else "none"),
        "seconds_of": {name: round(value, 3) for name, value in seconds.items()},
        "out": None if request.out is None else str(request.out),
        "warnings": list(solved.images.notes["warnings"]),
    }


def _show(console: Console, outcome: dict[str, Any], warnings: list[str]) -> None:
    table = Table(show_header=False)
    table.add_row("images", str(outcome["images"]))
    table.add_row("normals", str(outcome["normals"]))
    table.add_row("solver", outcome["solver"] + (f" ({outcome['why']})" if outcome["why"] else ""))
    if outcome["sigma_mean_deg"] is not None:
        table.add_row("mean σ", f"{outcome['sigma_mean_deg']:.3f}°")
    if outcome["mean_deg"] is not None:
        table.add_row(
            "error",
            f"mean {outcome['mean_deg']:.2f}°, median {outcome['median_deg']:.2f}°, 95 % {outcome['p95_deg']:.2f}°",
        )
    table.add_row("seconds", f"{outcome['seconds']:.2f}")
    table.add_row("written to", outcome["out"] or "nowhere: name a folder with --out")
    console.print(table)
    for sentence in warnings:
        console.print(f"• {sentence}", highlight=False)


@contextmanager
def _scratch(out: Path | None) -> Generator[Path]:
    """Makes a temporary folder for unpacked images, on the disk of the output if there is one."""
    try:
        if out is not None:
            out.resolve().parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=".lightpose-", dir=None if out is None else out.resolve().parent)
    except OSError as error:
        raise RigError(
            ErrorCode.FOLDER_INVALID, f"{out or tempfile.gettempdir()}: cannot be written: {error}; name another folder"
        ) from error
    with folder as name:
        yield Path(name)


@contextmanager
def progress_bar(console: Console) -> Generator[Progress]:
    """Shows a progress bar on the error stream, which disappears when the block ends."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        yield bar


@contextmanager
def shown_step(bar: Progress, what: str) -> Generator[None]:
    """Shows the block as one step of the bar."""
    task = bar.add_task(what, total=None)
    yield
    bar.update(task, total=1, completed=1)


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Generator[None]:
    """Records the duration of the block under `name`, s."""
    started = time.monotonic()
    yield
    seconds[name] = time.monotonic() - started
