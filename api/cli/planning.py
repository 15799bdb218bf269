"""`lightpose plan`: plans lights to add to a folder's images, for a dome, a ring or another robot.

The folder is solved as by `lightpose solve`. The product's planner then chooses from the candidates of a file, of the
folder's other images, or of a free dome. All resulting numbers are in the folder's own frame and unit.
"""

import json
import re
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from acquisition import plan
from acquisition.formats.session_files import refuse_in_session
from acquisition.models.cell_config import MIN_SLANT_DEG
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.result import MEAN_ERROR_PER_SIGMA, ModelFinding
from acquisition.normals.alternatives import lamp_alternatives
from acquisition.normals.equivalent_session import EquivalentSession
from acquisition.normals.images.image_set import ImageSet
from acquisition.plan import design_problem
from acquisition.plan.candidate_lights import CandidateLights
from api.cli.plan_candidates import Offer, offered, reach, too_few
from api.cli.plan_capture import Capture, PlanRequest, invalid, read
from api.cli.solving import refuse_full_scale

MIN_PILOT = 3
"""Minimum number of images that determine a normal."""

FORECAST_COUNTS = (1, 2, 4, 8, 16)
"""Numbers of further lights for which the error is forecast."""

STEEPEST_DEG = 85.0
"""Upper bound of --max-slant-deg."""


def plan_request(
    folder: Path, count: int, candidates: Path | None = None, radius_mm: float | None = None,
    max_slant_deg: float | None = None, pilot: str | None = None, out: Path | None = None,
    full_scale: float | None = None,
) -> PlanRequest:  # fmt: skip
    """Parses the options of a command line. Raises RigError request.invalid naming the option."""
    if count < 1:
        raise invalid(f"--count {count}: plan at least one light")
    if count > (most := design_problem.MAX_CANDIDATES):
        raise invalid(f"--count {count}: at most {most} lights can be planned")
    if radius_mm is not None and not (np.isfinite(radius_mm) and radius_mm > 0):
        raise invalid(f"--radius-mm {radius_mm:g}: the radius must be positive")
    if radius_mm is not None and candidates is not None:
        raise invalid("--radius-mm is the radius of a free dome and cannot be combined with --candidates")
    if max_slant_deg is not None and not MIN_SLANT_DEG < max_slant_deg <= STEEPEST_DEG:
        raise invalid(
            f"--max-slant-deg {max_slant_deg:g}: give more than {MIN_SLANT_DEG:g} and at most {STEEPEST_DEG:g}"
        )
    if out is not None and out.exists() and not out.is_file():
        raise invalid(f"--out {out}: is not a file: name a file")
    numbers = None
    if pilot is not None:
        if not re.fullmatch(r"\s*\d+\s*(,\s*\d+\s*)*", pilot):
            raise invalid(f"--pilot {pilot}: give the images' numbers, counted from 0, such as 0,7,31,90")
        numbers = tuple(int(number) for number in pilot.split(","))
    refuse_full_scale(full_scale)
    return PlanRequest(folder, count, candidates, radius_mm, max_slant_deg, numbers, out, full_scale)


def run(request: PlanRequest) -> dict[str, Any]:
    """Solves the pilot and plans the lights; prints a table for people and returns the figures for programs.

    Raises RigError request.invalid for options that do not fit the folder, folder.invalid, normals.infeasible and
    plan.infeasible.
    """
    started = time.monotonic()
    if request.out is not None:
        _refuse_out(request.out)
    console = Console(stderr=True, markup=False)
    with tempfile.TemporaryDirectory(prefix="lightpose-") as scratch, console.status("reading"):
        capture = read(request, Path(scratch))
        warnings: list[str] = capture.images.notes["warnings"] if isinstance(capture.images, ImageSet) else []
        for sentence in warnings:  # first, because they may be the cause of a refusal
            console.print(f"• {sentence}", highlight=False)
        pilot = _pilot(request, len(capture.lights))
        offer = offered(request, capture, pilot)
        if offer is not None and request.count > len(offer.numbers):
            raise too_few(request, offer)
        console.print("solving the pilot", style="dim")
        session = capture.solved(pilot)
    findings = _findings(request, session, pilot)
    places, offer = reach(request, capture, session, offer)
    problem = plan.DesignProblem.of(
        session.normal_map, session.observations, capture.recipe, places, session.calibration, surround=offer is None
    )
    if not np.any(problem.options.visible):
        what, advice = ("the candidates", "their positions, axes and unit")
        if offer is None:
            what, advice = ("the lights of the free dome", "--radius-mm, which may be less than the object's")
        raise RigError(ErrorCode.PLAN_INFEASIBLE, f"none of {what} would light the object: check {advice}")
    chosen = plan.choose(problem, request.count, forecast_counts=FORECAST_COUNTS)
    outcome = _outcome(request, capture, pilot, places, chosen, offer)
    outcome["findings"] = [finding.model_dump() for finding in findings]
    outcome["seconds"] = round(time.monotonic() - started, 3)
    _show(console, capture, outcome)
    outcome["notes"] += warnings
    if request.out is not None:
        _write(outcome, request.out)
    return outcome


# ------------------------------------------------------------------------------------------------------ what is given


def _pilot(request: PlanRequest, count: int) -> tuple[int, ...]:
    """Returns the numbers of the pilot's images."""
    pilot = tuple(range(count)) if request.pilot is None else request.pilot
    outside = sorted({number for number in pilot if number >= count})
    if outside:
        raise invalid(
            f"--pilot {_list(outside)}: {request.folder} has {count} images, which are counted from 0 to {count - 1}"
        )
    doubled = sorted({number for number in pilot if pilot.count(number) > 1})
    if doubled:
        raise invalid(f"--pilot {_list(doubled)}: given more than once: name each image once")
    if len(pilot) < MIN_PILOT:
        raise invalid(f"the pilot has {len(pilot)} image(s), but a normal needs at least three: add images")
    return pilot


# ------------------------------------------------------------------------------------------------------ what comes out


def _findings(request: PlanRequest, session: EquivalentSession, pilot: Sequence[int]) -> list[ModelFinding]:
    """Returns the findings about the pilot's images, with images numbered as in the folder.

    Raises RigError folder.invalid if the lamps' axes were corrected: candidates would be in the same wrong axes, or the
    plan would be in another frame than the folder.
    """
    findings = [
        finding.model_copy(update={"value": float(pilot[int(finding.value)])})
        if finding.kind == "bad image" and finding.value is not None
        else finding
        for finding in session.normal_map.findings
    ]
    for finding in findings:
        if finding.kind == lamp_alternatives.AXES and finding.corrected:
            raise RigError(
                ErrorCode.FOLDER_INVALID,
                f"{request.folder}: {finding.message}. The plan would be in the same wrong axes as the candidates. "
                "Correct the lamps' axes in the folder's file of lights, and those of all candidates, and plan again "
                "(if they are right, see `lightpose solve`: among few images, a bad one can look like wrong axes)",
                file=str(request.folder),
            )
    return findings


def _outcome(
    request: PlanRequest,
    capture: Capture,
    pilot: Sequence[int],
    reach: CandidateLights,
    chosen: LightPlan,
    offer: Offer | None,
) -> dict[str, Any]:
    """Returns the figures of `--json`. Errors are means over the pixels seen within 78° of their normal."""
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
            notes.append(f"only {most} of {len(offer.numbers)} candidates, evenly over the list, were considered")
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
    doubtful = [finding["message"] for finding in outcome["findings"] if not finding["corrected"]]
    for sentence in doubtful:
        console.print(f"Do not rely on this plan: {sentence}.", style="bold red", highlight=False)
    console.print(table)
    console.print(
        f"Expected mean error with these lights: {outcome['forecast_mean_deg']:.2f}° ({MEAN_ERROR_PER_SIGMA} × mean σ)."
    )
    corrected = [f"{one['message']} (taken into account)" for one in outcome["findings"] if one["corrected"]]
    for sentence in (*corrected, *outcome["notes"]):
        console.print(f"• {sentence}", highlight=False)


def _refuse_out(out: Path) -> None:
    """Refuses an output file that cannot be written or is not a plan, before anything is read. Raises RigError."""
    refuse_in_session(out, "--out")
    try:
        if out.exists():
            content: Any = json.loads(out.read_bytes())
            if not isinstance(content, dict) or "forecast_mean_deg" not in content:
                raise ValueError
        folder = next(one for one in out.absolute().parents if one.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise invalid(f"--out {out}: cannot be written: {error}; name another file", out) from error
    except ValueError as error:
        raise invalid(f"--out {out}: exists, is not a plan and would be replaced: name another file", out) from error


def _write(outcome: dict[str, Any], out: Path) -> None:
    """Writes the JSON object atomically."""
    partial = out.with_name(f".{out.name}.part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(outcome, indent=2) + "\n", encoding="utf-8")
        partial.replace(out)
    except OSError as error:
        raise invalid(f"--out {out}: cannot be written: {error}", out) from error


def _mean_error(sigma_deg: float | None) -> float | None:
    return None if sigma_deg is None else MEAN_ERROR_PER_SIGMA * sigma_deg


def _list(numbers: Sequence[int]) -> str:
    return ",".join(str(number) for number in numbers)
