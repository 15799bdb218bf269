"""`lightpose demo`: a full session in a simulated cell, as a user would run it, graded against the truth.

Cell and service are separate processes, and the client for scripts runs the session over HTTP, so that the
demonstration exercises what a user gets. Only the grading reads the cell's truth.
"""

import contextlib
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from acquisition.formats.session_files import refuse_in_session
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError, in_words
from acquisition.models.recipe import Recipe
from acquisition.models.rounding import percent
from acquisition.store import Store
from api.cli import lights_file
from api.client.client import Client
from hardware_sim import grade, nominal, object_spec, truth
from hardware_sim.cell import READY_WITHIN_S
from hardware_sim.object_spec import ObjectSpec

STOP_TIMEOUT_S = 15.0
"""Time after which a process that does not end is killed, s."""

CELL_PORTS = (29999, 30001, 30002, 30003, 30004, 30100, 30200)
"""Ports that a simulated cell binds."""

RECIPE_OPTIONS = {
    "pilot_lights": "--pilot", "planned_lights": "--planned", "method": "--method", "user_lights": "--lights",
    "seed": "--seed",
}  # fmt: skip
"""Options that give the fields of the recipe."""

STAGES = ("pilot", "waypoints", "capture", "normals", "plan", "estimate")


@dataclass(frozen=True)
class DemoOptions:
    """Options of the demonstration: object, method, errors, image size, folders."""

    spec: ObjectSpec
    seed: int
    pilot_lights: int
    planned_lights: int
    method: str
    profile: str
    compare_random: bool
    speed: float
    pixels: int
    data: Path
    lights: Path | None = None
    perturbed: bool = False


def run(options: DemoOptions) -> dict[str, Any]:
    """Runs the demonstration and returns its figures; prints progress and a table.

    Raises RigError before anything starts if the object cannot be made or does not fit, and if cell, service or session
    fail.
    """
    console = Console(stderr=False)
    folder = prepared_folder(options)
    recipe = recipe_of(options, options.method)
    start = time.monotonic()
    with cell(options, folder) as cell_file, service(cell_file, folder) as url, Client(url) as client:
        connect_s = time.monotonic() - start
        console.print(f"Service at {url}, simulated cell with the object '{options.spec.label}', seed {options.seed}")
        end_previous_session(client)
        session_id = capture(client, recipe)
        grades = _grades(folder, cell_file, session_id)
        stages = seconds_of(client, session_id)
        predicted = client.results(session_id)[-1].summary.predicted_median_deg
        random_grade = None
        if options.compare_random and options.method != "random":
            other = capture(client, recipe_of(options, "random"))
            random_grade = _grades(folder, cell_file, other)[-1]
        final, results = grades[-1], folder / "data" / "sessions" / session_id / "results" / str(len(grades) - 1)
        gradings = _gradings(cell_file, results)
    outcome = {
        "session_id": session_id,
        "object": options.spec.label,
        "seed": options.seed,
        "method": options.method,
        "profile": options.profile,
        "lights_total": recipe.lights_total,
        "mean_deg": final.mean_deg,
        "median_deg": final.median_deg,
        "p95_deg": final.p95_deg,
        "pilot_mean_deg": grades[0].mean_deg if len(grades) > 1 else None,
        "pilot_median_deg": grades[0].median_deg if len(grades) > 1 else None,
        "random_mean_deg": None if random_grade is None else random_grade.mean_deg,
        "random_median_deg": None if random_grade is None else random_grade.median_deg,
        "predicted_median_deg": predicted,
        "sigma_median_deg": final.predicted_median_deg,
        "within_sigma": final.within_sigma,
        "coverage": final.coverage,
        "graded_pixels": final.graded_pixels,
        "gradings": {name: graded.as_dict() for name, graded in gradings.items()},
        "seconds": {"connect": round(connect_s, 2), **stages, "total": round(time.monotonic() - start, 2)},
        "results": str(results),
    }
    _show(console, options, grades, random_grade, outcome)
    return outcome


def serve_page(options: DemoOptions) -> None:
    """Serves the operator's page of a simulated cell until interrupted, and prints its address.

    Raises RigError when the object cannot be made or does not fit, and when cell or service fail.
    """
    console = Console(stderr=False)
    folder = prepared_folder(options)
    with cell(options, folder) as cell_file, service(cell_file, folder) as url, Client(url) as client:
        end_previous_session(client)
        console.print(f"Simulated cell with the object '{options.spec.label}', {options.speed:g} × real speed")
        console.print(f"page {url}/", highlight=False, soft_wrap=True)
        console.print("Ctrl+C ends it")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


def prepared_folder(options: DemoOptions) -> Path:
    """Prepares the demonstration's folder. Raises RigError for a bad option and while another demonstration uses it."""
    object_spec.check(options.spec, options.seed, nominal.default_cell_file())
    if options.lights is not None and options.method != "user":
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--lights {options.lights}: is for --method user, not {options.method}: correct one of them",
        )
    recipe_of(options, options.method)
    refuse_in_session(options.data, "--data")
    folder = options.data.resolve()
    (folder / "log").mkdir(parents=True, exist_ok=True)
    Store(folder / "data").close()  # raises while in use, before the cell of a running demo is overwritten
    return folder


def recipe_of(options: DemoOptions, method: str) -> Recipe:
    """Returns the recipe of the options with one method. Raises RigError request.invalid naming the option."""
    values: dict[str, Any] = {
        "method": method,
        "pilot_lights": options.pilot_lights,
        "planned_lights": options.planned_lights,
        "seed": options.seed,
        "label": f"{options.spec.label[:150]}, {method}",
    }
    if method == "user" and options.lights is not None:
        values["user_lights"] = lights_file.read(options.lights)
    try:
        return Recipe.model_validate(values)
    except ValidationError as error:
        wrong = error.errors()[0]
        field = str(wrong["loc"][0]) if wrong["loc"] else "user_lights"
        option, given = RECIPE_OPTIONS.get(field, field), values.get(field)
        shown = "" if field == "user_lights" else f" {given}"
        raise RigError(ErrorCode.REQUEST_INVALID, f"{option}{shown}: {in_words(wrong)}") from error


def end_previous_session(client: Client) -> None:
    """Stops an interrupted demonstration's session and acknowledges its faults, as nobody is in a simulated cell."""
    holder = client.rig().holder
    if holder is not None:
        client.stop(holder)
    if client.safety().faults:
        client.acknowledge()


def capture(client: Client, recipe: Recipe) -> str:
    """Runs one session to its end; returns its id. Raises ProblemError when it does not complete."""
    return client.capture(recipe, progress=True).id


def _truth(cell_file: Path) -> tuple[truth.Truth, Calibration]:
    """Reads the simulated cell's true scene and its nominal calibration from beside its cell file."""
    return truth.load(cell_file.parent / "truth.npz"), cell_config.load_calibration(
        cell_file.parent / "calibration.json"
    )


def _grades(folder: Path, cell_file: Path, session_id: str) -> list[grade.Grade]:
    """Grades each result of a session against the truth, the pilot's first."""
    true, calibration = _truth(cell_file)
    results = sorted((folder / "data" / "sessions" / session_id / "results").iterdir(), key=lambda path: int(path.name))
    return [grade.grade_folder(result, true, calibration) for result in results]


def _gradings(cell_file: Path, result: Path) -> dict[grade.Grading, grade.Grade]:
    """Grades one result against the truth over each of the three sets of pixels."""
    true, calibration = _truth(cell_file)
    return {grading: grade.grade_folder(result, true, calibration, grading) for grading in grade.GRADINGS}


def seconds_of(client: Client, session_id: str) -> dict[str, float]:
    """Returns the seconds spent in each stage, from the times of the events."""
    spent = dict.fromkeys(STAGES, 0.0)
    stage, since = None, 0.0
    for event in client.past_events(session_id):
        if stage in spent:
            spent[stage] += event.at.timestamp() - since
        if event.type == "session.stage":
            stage = event.body["stage"]
        since = event.at.timestamp()
    return {name: round(seconds, 2) for name, seconds in spent.items()}


def _show(
    console: Console,
    options: DemoOptions,
    grades: list[grade.Grade],
    random_grade: grade.Grade | None,
    outcome: dict[str, Any],
) -> None:
    table = Table(
        title="Angular error of the normals, degrees",
        caption="over the pixels whose true normal is within 78° of the viewing ray, object's mask eroded by one pixel",
    )
    for column in ("lights", "images", "mean", "median", "95 %", "coverage"):
        table.add_column(column, justify="left" if column == "lights" else "right")
    rows = [(options.method, outcome["lights_total"], grades[-1])]
    if len(grades) > 1:
        rows.insert(0, ("pilot", options.pilot_lights, grades[0]))
    if random_grade is not None:
        rows.append(("random", outcome["lights_total"], random_grade))
    for name, images, row in rows:
        table.add_row(
            name,
            str(images),
            f"{row.mean_deg:.2f}",
            f"{row.median_deg:.2f}",
            f"{row.p95_deg:.2f}",
            f"{percent(row.coverage)}",
        )
    console.print(table)
    means = {name: graded["mean_deg"] for name, graded in outcome["gradings"].items()}
    console.print(
        f"Mean error: {means['one_surface']:.2f}° where pixels show one surface, {means['within_78_deg']:.2f}° within "
        f"78°, {means['object']:.2f}° over all pixels of the object"
    )
    forecast = outcome["predicted_median_deg"]
    predicted = "none for fixed patterns" if forecast is None else f"{forecast:.2f}°"
    sigma = outcome["sigma_median_deg"]
    by_sigma = "" if sigma is None else f", by the result's own σ {sigma:.2f}°"
    console.print(
        f"Median error: predicted before the capture {predicted}{by_sigma}, observed {outcome['median_deg']:.2f}°"
    )
    spent = [f"{name} {seconds:g}" for name, seconds in outcome["seconds"].items() if seconds]
    console.print("Seconds: " + ", ".join(spent), highlight=False)
    console.print(f"Results: {outcome['results']}", soft_wrap=True, highlight=False)
    console.print("  report.html, normals.png, normals.tiff, depth.tiff, sigma_deg.tiff, albedo.tiff, mask.png, …")


@contextlib.contextmanager
def cell(options: DemoOptions, folder: Path) -> Generator[Path]:
    """Runs the simulated cell as a process; yields its cell file."""
    arguments = [
        "sim", "--address", _free_address(), *options.spec.arguments(), "--seed", str(options.seed),
        "--profile", options.profile, "--speed", str(options.speed), "--pixels", str(options.pixels),
        "--folder", str(folder / "cell"), "--record", str(folder / "cell" / "ticks.record"),
        *["--perturb"] * options.perturbed,
    ]  # fmt: skip
    (folder / "cell").mkdir(exist_ok=True)
    with _process(arguments, folder / "log" / "sim.log", r"^ready ") as _:
        yield folder / "cell" / "cell.toml"


@contextlib.contextmanager
def service(cell_file: Path, folder: Path) -> Generator[str]:
    """Runs the service as a process; yields its address."""
    arguments = ["serve", "--cell", str(cell_file), "--data", str(folder / "data"), "--port", "0"]
    with _process(arguments, folder / "log" / "serve.log", r"(http://[\d.]+:\d+)") as match:
        yield match.group(1)


@contextlib.contextmanager
def _process(arguments: list[str], log: Path, ready: str) -> Generator[re.Match[str]]:
    """Runs a lightpose command as a process, ended at exit; yields the match of `ready` in its log."""
    with log.open("w", encoding="utf-8") as file:
        process = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-m", "api.cli", *arguments], stdout=file, stderr=subprocess.STDOUT
        )
    try:
        yield _wait_for_line(process, log, ready)
    finally:
        process.terminate()
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait_for_line(process: "subprocess.Popen[bytes]", log: Path, ready: str) -> re.Match[str]:
    deadline = time.monotonic() + READY_WITHIN_S
    while time.monotonic() < deadline:
        text = log.read_text(encoding="utf-8", errors="replace")
        match = re.search(ready, text, re.MULTILINE)
        if match is not None:
            return match
        if process.poll() is not None:
            raise RigError(ErrorCode.SERVICE_FAULT, f"a process of the demonstration ended: {text[-800:].strip()}")
        time.sleep(0.05)
    raise RigError(ErrorCode.SERVICE_FAULT, f"not ready within {READY_WITHIN_S:g} s; see {log}")


def _free_address() -> str:
    """Returns a loopback address whose controller ports are free. Raises RigError service.fault without one."""
    first = os.getpid() % 250  # demonstrations that start at the same time try different addresses
    for number in range(250):
        address = f"127.0.7.{2 + (first + number) % 250}"
        try:
            for port in CELL_PORTS:
                with socket.socket() as probe:
                    probe.bind((address, port))
        except OSError:
            continue
        return address
    raise RigError(ErrorCode.SERVICE_FAULT, "no free loopback address for a simulated cell")
