"""The plan of a dome of 96 lamps against random choices: `python -m tests.unseen dome …`, one JSON line each choice.

A scene is rendered under all lamps and written as a near-light folder. `lightpose plan FOLDER --pilot … --count …`
names further lamps; its candidates are the rest of the folder. The images of pilot and plan are solved as by
`lightpose solve`. Random choices from the same folder are solved likewise: of `any` lamps, or of the `pilot`'s and any
further ones. The result is the share of random choices with a smaller error than the plan's. A run continues where an
earlier one with the same file stopped.
"""

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from acquisition import geometry, pilot
from acquisition.formats import folders
from acquisition.models.errors import RigError
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.normals import near_light
from acquisition.normals.images.image_set import ImageSet
from acquisition.plan.candidate_lights import CandidateLights
from tests.unseen import grading, scenes
from tests.unseen.captures import capture, write_folder
from tests.unseen.patterns import PILOT_LIGHTS
from tests.unseen.run import Line, append, over_scenes
from tests.unseen.scenes import Scene

LAMPS = 96
SLANT_DEG = (10.0, 70.0)
PLANNED, PILOT = "plan", "pilot alone"
KINDS = ("any", "pilot")
IDENTITY = ("family", "seed", "reflectance", "pixels", "count", "kind", "choice")
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Replay:
    """The solves of a run: for each scene the plan of `count` images in all, the pilot alone, and random choices."""

    families: Sequence[str]
    seeds: Sequence[int]
    count: int
    kinds: Sequence[str]
    choices: int
    out: Path
    reflectance: str | None = None
    pixels: int = scenes.PIXELS
    report: bool = False
    done: frozenset[tuple[object, ...]] = field(default=frozenset())

    def of_scene(self, family: str, seed: int) -> Iterator[Line]:
        """The missing choices of one scene, the plan first."""
        drawn = [(PLANNED, 0), (PILOT, 0), *((kind, k) for k in range(self.choices) for kind in self.kinds)]
        for kind, choice in drawn:
            values = (family, seed, self.reflectance, self.pixels, self.count, kind, choice)
            if values not in self.done:
                yield dict(zip(IDENTITY, values, strict=True))


def lamps(scene: Scene) -> np.ndarray:
    """Positions (96, 3) of the dome's lamps, m, view frame: a Fibonacci lattice between the slants, equal areas."""
    cosine = np.linspace(*np.cos(np.radians(SLANT_DEG)), LAMPS)
    units = geometry.direction(np.arccos(cosine), np.arange(LAMPS) * np.pi * (3 - np.sqrt(5)))
    return scene.center + scene.radius_m * units


def pilot_numbers(scene: Scene) -> list[int]:
    """Numbers of the dome's lamps that match the recipe's pilot best."""
    dome = CandidateLights(lamps(scene), scene.center)
    return dome.numbers(pilot.pattern(Recipe(pilot_lights=PILOT_LIGHTS), dome))


def planned(folder: Path, first: Sequence[int], count: int) -> tuple[list[int], float]:
    """Numbers of `count` further lamps that the command line's plan names, and the mean error that it forecasts."""
    command = [sys.executable, "-m", "api.cli", "plan", str(folder), "--count", str(count), "--json"]
    command += ["--pilot", ",".join(map(str, first))]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    outcome = json.loads(done.stdout)
    return [light["number"] for light in outcome["lights"]], outcome["forecast_mean_deg"]


def random_choice(line: Line, first: Sequence[int], count: int) -> list[int]:
    """Numbers of `count` random lamps, which the scene and the choice determine."""
    rng = np.random.default_rng([int(str(line["seed"])), KINDS.index(str(line["kind"])), int(str(line["choice"]))])
    kept = list(first) if line["kind"] == "pilot" else []
    free = np.setdiff1d(np.arange(LAMPS), kept)
    return [*kept, *rng.permutation(free)[: count - len(kept)].tolist()]


def solved(images: ImageSet, scene: Scene, numbers: Sequence[int]) -> Line:
    """Grades of a solve of the folder's images with these numbers; a refusal is stored in `error`, as unsolved."""
    refused: Line = {}
    try:
        mapped = near_light.solve(images.only(numbers), SolveSettings())
    except RigError as error:
        refused["error"] = str(error)
        nothing = np.zeros_like(scene.truth.object)
        return refused | grading.errors(np.zeros_like(scene.truth.normals), nothing, scene.truth)
    return refused | grading.errors(mapped.normals, mapped.mask, scene.truth)


def run_scene(run: Replay, family: str, seed: int) -> int:
    """Solves one scene's missing choices and appends them to the run's file; returns their number."""
    lines = list(run.of_scene(family, seed))
    if not lines:
        return 0
    with scenes.report_seeds() if run.report else nullcontext():
        scene = scenes.scene(family, seed, run.reflectance, run.pixels)
    first = pilot_numbers(scene)
    with tempfile.TemporaryDirectory(prefix="unseen-dome-") as scratch:
        folder = Path(scratch) / "dome"
        write_folder(folder, scene, capture(scene, lamps(scene)))
        images = folders.read(folder, Path(scratch))
        for line in lines:
            extra: Line = {}
            if line["kind"] == PLANNED:
                further, forecast = planned(folder, first, run.count - len(first))
                numbers = [*first, *further]
                extra["forecast"] = forecast
            else:
                numbers = first if line["kind"] == PILOT else random_choice(line, first, run.count)
            append(run.out, line | {"lamps": numbers} | extra | solved(images, scene, numbers))
    return len(lines)


def run_all(run: Replay, jobs: int) -> int:
    """Solves all scenes in `jobs` processes; returns the number of added lines."""
    return over_scenes(partial(run_scene, run), run.families, run.seeds, jobs)


def table(lines: Sequence[Line], grading_name: str) -> str:
    """Table of each scene's errors and share of random choices with a smaller error than the plan's; family means."""
    scenes_errors: dict[tuple[object, ...], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        scene = tuple(line.get(name) for name in IDENTITY[:5])
        scenes_errors[scene][str(line["kind"])].append(float(str(line[f"{grading_name}.mean"])))
        if "forecast" in line:
            scenes_errors[scene]["expected"].append(float(str(line["forecast"])))
    rows: list[str] = []
    shares: dict[str, dict[object, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (family, seed, reflectance, pixels, count), errors in scenes_errors.items():
        if PLANNED not in errors:
            continue
        ours = errors[PLANNED][0]
        row = f"{family:9} {seed:>4} {reflectance or 'own':12} {pixels:>4} px {count:>3} images"
        row += "".join(f"  {name} {errors[name][0]:6.2f}" for name in (PLANNED, "expected", PILOT) if name in errors)
        for kind in KINDS:
            if kind in errors:
                share = float(np.mean(np.array(errors[kind]) < ours))
                shares[kind][family].append(share)
                row += f"  {kind}: median {np.median(errors[kind]):6.2f} of {len(errors[kind])}, better {share:6.1%}"
        rows.append(row)
    for kind, by_family in shares.items():
        mean = np.mean([np.mean(values) for values in by_family.values()])
        rows.append(f"choices of {kind} better than the plan, mean over families: {mean:.1%}")
    return "\n".join(rows)
