"""`lightpose plan`: which lights to add to a folder's images, for a dome, a ring or another robot.

The folder is solved as by `lightpose solve`, and the product's planner chooses from the candidates: of a file, of the
folder's other images, or of a free dome. All numbers that come out are in the folder's own frame and unit.
"""

import json
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from acquisition import geometry, plan
from acquisition.formats import folders
from acquisition.formats.folders import near_light_folder, session_folder
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import MAX_SLANT_DEG, MIN_SLANT_DEG
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import MEAN_ERROR_PER_SIGMA, SolveSettings
from acquisition.normals import distant, equivalent_session, near_light
from acquisition.normals.equivalent_session import EquivalentSession
from acquisition.normals.images.image_set import DistantLights, ImageSet, NearLights, check
from acquisition.plan import design_problem
from acquisition.plan.candidate_lights import CandidateLights
from acquisition.runner.session_solve import solve_in_cell
from api.cli.solving import refuse_full_scale, session_full_scale

MIN_PILOT = 3
"""Images that give a normal at the least."""

SAME_LIGHT_DEG = 0.5
"""Angle at the object within which a candidate of a file counts as a light of the pilot, which has been captured."""

FORECAST_COUNTS = (1, 2, 4, 8, 16)
"""Numbers of further lights for which the error is forecast."""

STEEPEST_DEG = 85.0
"""Upper bound of --max-slant-deg."""


@dataclass(frozen=True)
class PlanRequest:
    """Options of one plan; None where they are not given."""

    folder: Path
    count: int
    candidates: Path | None = None
    radius_mm: float | None = None
    max_slant_deg: float | None = None
    pilot: tuple[int, ...] | None = None
    out: Path | None = None
    full_scale: float | None = None


@dataclass(frozen=True)
class Frame:
    """A folder's own frame: the word for its lights, its axes and unit in words, and its numbers' conversion.

    `view_from_own` (3, 3) turns its numbers into the view frame, in m or, of directions, of any length.
    """

    word: str  # position or direction
    axes: str
    unit: str | None
    view_from_own: FloatArray

    def view(self, own: FloatArray) -> FloatArray:
        """Positions in m, or directions, in the view frame, of numbers (K, 3) of the folder."""
        return own @ self.view_from_own.T

    def own(self, view: FloatArray) -> FloatArray:
        """The inverse of `view`."""
        return view @ np.linalg.inv(self.view_from_own).T


VIEW_AXES, CAMERA_AXES = "x right, y up, z to the camera", "x right, y down, z away from the camera (OpenCV)"


@dataclass(frozen=True)
class Capture:
    """A folder's images: its frame, the numbers (F, 3) of its lights in it, their names, and its recipe."""

    frame: Frame
    lights: FloatArray
    names: tuple[str, ...]
    images: ImageSet | session_folder.SessionCapture
    recipe: Recipe

    def solved(self, pilot: Sequence[int]) -> EquivalentSession:
        """Solves the images `pilot` as `lightpose solve` does."""
        if isinstance(self.images, session_folder.SessionCapture):
            captured = self.images.observations(len(self.images.plans) - 1)
            lit = [shot for shot in captured.shots if shot.light is not None]
            observations = replace(captured, shots=[lit[number] for number in pilot])
            calibration = self.images.calibration
            normal_map = solve_in_cell(observations, self.images.cell, calibration, SolveSettings())
            return EquivalentSession(normal_map, observations, calibration)
        images = self.images.only(pilot)
        check(images)
        near = images if isinstance(images.lights, NearLights) else distant.from_afar(images)
        return equivalent_session.of_near(near, near_light.solve(near, SolveSettings()))


@dataclass(frozen=True)
class Offer:
    """Candidates of a list: numbers (K, 3) in the folder's frame, the number of each in its list, and what they are."""

    own: FloatArray
    numbers: tuple[int, ...]
    what: str
    notes: tuple[str, ...] = ()

    def only(self, kept: np.ndarray, note: str = "") -> "Offer":
        """Those of the boolean array `kept` (K,)."""
        numbers = tuple(number for number, keep in zip(self.numbers, kept, strict=True) if keep)
        return Offer(self.own[kept], numbers, self.what, (*self.notes, note) if note else self.notes)


def plan_request(
    folder: Path, count: int, candidates: Path | None = None, radius_mm: float | None = None,
    max_slant_deg: float | None = None, pilot: str | None = None, out: Path | None = None,
    full_scale: float | None = None,
) -> PlanRequest:  # fmt: skip
    """Parses the options of a command line. Raises RigError request.invalid naming the option."""
    if count < 1:
        raise _invalid(f"--count {count}: plan one light at the least")
    if radius_mm is not None and not (np.isfinite(radius_mm) and radius_mm > 0):
        raise _invalid(f"--radius-mm {radius_mm:g}: the radius must be positive")
    if radius_mm is not None and candidates is not None:
        raise _invalid("--radius-mm is that of a free dome: leave it out where --candidates gives the positions")
    if max_slant_deg is not None and not MIN_SLANT_DEG < max_slant_deg <= STEEPEST_DEG:
        raise _invalid(
            f"--max-slant-deg {max_slant_deg:g}: give more than {MIN_SLANT_DEG:g} and at most {STEEPEST_DEG:g}"
        )
    if out is not None and out.exists() and not out.is_file():
        raise _invalid(f"--out {out}: is no file: name one")
    numbers = None
    if pilot is not None:
        if not re.fullmatch(r"\s*\d+\s*(,\s*\d+\s*)*", pilot):
            raise _invalid(f"--pilot {pilot}: give the images' numbers, counted from 0, such as 0,7,31,90")
        numbers = tuple(int(number) for number in pilot.split(","))
    refuse_full_scale(full_scale)
    return PlanRequest(folder, count, candidates, radius_mm, max_slant_deg, numbers, out, full_scale)


def run(request: PlanRequest) -> dict[str, Any]:
    """Solves the pilot and plans the lights; prints a table for people and returns the figures for programs.

    Raises RigError request.invalid for options that do not fit the folder, folder.invalid, normals.infeasible and
    plan.infeasible.
    """
    started = time.monotonic()
    console = Console(stderr=True, markup=False)
    with tempfile.TemporaryDirectory(prefix="lightpose-") as scratch, console.status("reading"):
        capture = _read(request, Path(scratch))
        pilot = _pilot(request, len(capture.lights))
        offer = _offer(request, capture, pilot)
        if offer is not None and request.count > len(offer.numbers):
            raise _too_few(request, offer)
        console.print("solving the pilot", style="dim")
        session = capture.solved(pilot)
    reach, offer = _reach(request, capture, session, offer)
    problem = plan.Problem.of(
        session.normal_map, session.observations, capture.recipe, reach, session.calibration, surround=offer is None
    )
    chosen = plan.choose(problem, request.count, forecast_counts=FORECAST_COUNTS)
    outcome = _outcome(request, capture, pilot, reach, chosen, offer)
    outcome["seconds"] = round(time.monotonic() - started, 3)
    _show(console, capture, outcome)
    if request.out is not None:
        _write(outcome, request.out)
    return outcome


# ------------------------------------------------------------------------------------------------------ what is given


def _read(request: PlanRequest, scratch: Path) -> Capture:
    folder = request.folder
    kind = folders.kind_of(folder)
    if kind == "session":
        if request.full_scale is not None:
            raise session_full_scale(folder)
        session = session_folder.read(folder)
        shots = [shot for shot in session.observations(len(session.plans) - 1).shots if shot.light is not None]
        lights = np.array([shot.light.position for shot in shots if shot.light is not None]).reshape(-1, 3)
        frame = Frame("position", VIEW_AXES, "m", np.eye(3))
        return Capture(frame, lights, tuple(shot.frame.path for shot in shots), session, session.recipe)
    images = folders.read(folder, scratch, full_scale=request.full_scale)
    if isinstance(images.lights, DistantLights):
        frame = Frame("direction", VIEW_AXES, None, np.eye(3))
        return Capture(frame, images.lights.directions, images.names, images, Recipe())
    unit = near_light_folder.unit(folder)
    to_view = geometry.VIEW_FROM_CAMERA[:3, :3] * near_light_folder.METRES[unit]
    frame = Frame("position", CAMERA_AXES, unit, to_view)
    return Capture(frame, frame.own(images.lights.positions_m), images.names, images, Recipe())


def _pilot(request: PlanRequest, count: int) -> tuple[int, ...]:
    """The numbers of the pilot's images."""
    pilot = tuple(range(count)) if request.pilot is None else request.pilot
    outside = sorted({number for number in pilot if number >= count})
    if outside:
        raise _invalid(
            f"--pilot {_list(outside)}: {request.folder} has {count} images, which are counted from 0 to {count - 1}"
        )
    doubled = sorted({number for number in pilot if pilot.count(number) > 1})
    if doubled:
        raise _invalid(f"--pilot {_list(doubled)}: given more than once: name each image once")
    if len(pilot) < MIN_PILOT:
        raise _invalid(f"the pilot has {len(pilot)} image(s): three are the least that give a normal; add images")
    return pilot


def _offer(request: PlanRequest, capture: Capture, pilot: Sequence[int]) -> Offer | None:
    """The candidates of a file, or of the images that are not the pilot's; none: a free dome."""
    if request.candidates is not None:
        own = read_candidates(request.candidates)
        return Offer(own, tuple(range(len(own))), f"{request.candidates}")
    rest = [number for number in range(len(capture.lights)) if number not in pilot]
    if not rest:
        if request.radius_mm is not None and capture.frame.word == "direction":
            raise _invalid(f"--radius-mm: {request.folder} gives directions, which have no radius: leave it out")
        return None
    if request.radius_mm is not None:
        raise _invalid(
            f"--radius-mm is that of a free dome, but {request.folder} offers the {len(rest)} images that are not the "
            "pilot's: leave it out, or the other images"
        )
    return Offer(capture.lights[rest], tuple(rest), f"{request.folder}, whose other images are the candidates,")


def read_candidates(path: Path) -> FloatArray:
    """The candidates (K, 3) of a file: three numbers on each line, white space or commas between them.

    No line may be left blank, so that numbers of lines are numbers of lights. Raises RigError request.invalid naming
    the line, counted from 1.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _invalid(f"--candidates {path}: cannot be read: {error}", path) from error
    if not lines:
        raise _invalid(f"--candidates {path}: is empty: write one light a line, three numbers each", path)
    rows: list[list[float]] = []
    for line, text in enumerate(lines, start=1):
        try:
            numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip())]
        except ValueError:
            numbers = []
        if len(numbers) != 3 or not np.all(np.isfinite(numbers)):
            raise _invalid(f"--candidates {path}, line {line}: {text.strip()[:60]!r} is not three numbers", path)
        rows.append(numbers)
    return np.array(rows)


def _reach(
    request: PlanRequest, capture: Capture, session: EquivalentSession, offer: Offer | None
) -> tuple[CandidateLights, Offer | None]:
    """The candidates about the object, and what is left of the offer."""
    center = session.center
    positions = [shot.light.position for shot in session.observations.shots if shot.light is not None]
    pilot = np.array(positions) - center
    if offer is None:
        radius_m = float(np.mean(np.linalg.norm(pilot, axis=1)))
        radius_m = radius_m if request.radius_mm is None else request.radius_mm / 1000
        slant_deg = MAX_SLANT_DEG if request.max_slant_deg is None else request.max_slant_deg
        return CandidateLights.dome(center, radius_m, float(np.radians(slant_deg))), None
    offsets = capture.frame.view(offer.own)
    if capture.frame.word == "position":
        offsets = offsets - center
    length = np.linalg.norm(offsets, axis=1)
    if np.min(length) <= 0:
        line = offer.numbers[int(np.argmin(length))]
        raise _invalid(f"{offer.what} light {line}, counted from 0, has no direction: correct it")
    units = offsets / length[:, None]
    if capture.frame.word == "direction":
        offsets = units * np.mean(np.linalg.norm(pilot, axis=1))
    seen = pilot / np.linalg.norm(pilot, axis=1, keepdims=True)
    kept, left = np.ones(len(units), np.bool_), offer
    if request.candidates is not None:
        kept = np.max(units @ seen.T, axis=1) < np.cos(np.radians(SAME_LIGHT_DEG))
    if not np.all(kept):
        left = left.only(kept, f"{np.count_nonzero(~kept)} candidates are lights of the pilot and were left out")
    if request.max_slant_deg is not None:
        within = np.degrees(geometry.slant_azimuth(units)[0]) <= request.max_slant_deg
        note = f"{np.count_nonzero(kept & ~within)} candidates are beyond slant {request.max_slant_deg:g}°"
        left = left.only(within[kept], note if np.any(kept & ~within) else "")
        kept &= within
    if len(left.numbers) < request.count:
        raise _too_few(request, left)
    return CandidateLights(center + offsets[kept], center), left


# ------------------------------------------------------------------------------------------------------ what comes out


def _outcome(
    request: PlanRequest,
    capture: Capture,
    pilot: Sequence[int],
    reach: CandidateLights,
    chosen: LightPlan,
    offer: Offer | None,
) -> dict[str, Any]:
    """The figures of `--json`; errors are means over the pixels seen within 78° of their normal."""
    frame = capture.frame
    notes = list(chosen.notes)
    if offer is None:
        view = np.array([light.position for light in chosen.lights])
        if frame.word == "direction":
            view = (view - reach.center) / np.linalg.norm(view - reach.center, axis=1, keepdims=True)
        lights: list[dict[str, Any]] = [{frame.word: row} for row in frame.own(view).tolist()]
    else:
        places = reach.numbers(chosen.lights)
        lights = [{frame.word: offer.own[place].tolist(), "number": offer.numbers[place]} for place in places]
        notes += offer.notes
        if len(offer.numbers) > (most := design_problem.MAX_CANDIDATES):
            notes.append(f"{most} of {len(offer.numbers)} candidates, evenly over the list, were considered")
    return {
        "lights": lights,
        "forecast_mean_deg": _mean_error(chosen.predicted_sigma_deg),
        "forecast": [
            {"added": point.added, "lights": point.lights, "mean_deg": _mean_error(point.sigma_deg)}
            for point in chosen.forecast
        ],
        "efficiency": chosen.efficiency,
        "two_rings_efficiency": chosen.two_rings_efficiency,
        "reasons": chosen.reasons,
        "gains": chosen.gains,
        "notes": notes,
        "folder": str(request.folder),
        "pilot": list(pilot),
        "candidates": len(reach.candidates),
        "axes": frame.axes,
        "unit": frame.unit,
    }


def _show(console: Console, capture: Capture, outcome: dict[str, Any]) -> None:
    frame = capture.frame
    table = Table(
        title=f"{len(outcome['lights'])} lights to add: {frame.axes}" + (f"; {frame.unit}" if frame.unit else "")
    )
    numbered = "number" in outcome["lights"][0]
    for column in (*(("number",) if numbered else ()), frame.word, "why"):
        table.add_column(column)
    for light, reason in zip(outcome["lights"], outcome["reasons"], strict=True):
        place = " ".join(f"{value:.5g}" for value in light[frame.word])
        table.add_row(*((str(light["number"]),) if numbered else ()), place, reason)
    console.print(table)
    console.print(
        f"Mean error expected after them: {outcome['forecast_mean_deg']:.2f}° ({MEAN_ERROR_PER_SIGMA} × mean σ)."
    )
    for sentence in outcome["notes"]:
        console.print(f"• {sentence}", highlight=False)


def _write(outcome: dict[str, Any], out: Path) -> None:
    """Writes the JSON object; the file appears complete or not at all."""
    partial = out.with_name(f".{out.name}.part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(outcome, indent=2) + "\n", encoding="utf-8")
        partial.replace(out)
    except OSError as error:
        raise _invalid(f"--out {out}: cannot be written: {error}", out) from error


def _mean_error(sigma_deg: float | None) -> float | None:
    return None if sigma_deg is None else MEAN_ERROR_PER_SIGMA * sigma_deg


def _too_few(request: PlanRequest, offer: Offer) -> RigError:
    have = len(offer.numbers)
    if not have:
        return _invalid(f"{offer.what} leaves no candidates: give positions that are not the pilot's")
    return _invalid(f"--count {request.count}: {offer.what} leaves {have} candidates: ask for no more than these")


def _list(numbers: Sequence[int]) -> str:
    return ",".join(str(number) for number in numbers)


def _invalid(detail: str, path: Path | None = None) -> RigError:
    return RigError(ErrorCode.REQUEST_INVALID, detail, **({} if path is None else {"file": str(path)}))
