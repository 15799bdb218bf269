"""Runs of the bench: solves captures of many scenes by many patterns, one JSON line for each solve.

A run continues where an earlier one with the same file stopped. Scenes are distributed over processes, each of which
renders and solves its own. Solves of one scene share pilot, renders and truth.
"""

import fcntl
import itertools
import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from acquisition import normals
from acquisition.models.errors import RigError
from acquisition.models.result import NormalMap, SolveSettings
from tests.unseen import faults, grading, patterns, scenes, trials
from tests.unseen.captures import Capture, capture
from tests.unseen.patterns import PLANNED
from tests.unseen.scenes import Scene

Line = dict[str, object]
IDENTITY = ("family", "seed", "reflectance", "fault", "solver", "pattern", "lights", "azimuth")
"""Keys that identify one solve."""


@dataclass(frozen=True)
class Plan:
    """The solves of a run."""

    families: Sequence[str]
    seeds: Sequence[int]
    lights: Sequence[int]
    patterns: Sequence[str]
    azimuths: int
    out: Path
    fault: str | None = None
    reflectance: str | None = None
    solver: str = "product"
    report: bool = False
    done: frozenset[tuple[object, ...]] = field(default=frozenset())

    def of_scene(self, family: str, seed: int) -> Iterator[Line]:
        """The missing solves of one scene."""
        for azimuth, pattern, count in itertools.product(range(self.azimuths), self.patterns, self.lights):
            line: Line = {
                "family": family, "seed": seed, "reflectance": self.reflectance, "fault": self.fault,
                "solver": self.solver, "pattern": pattern, "lights": count, "azimuth": azimuth,
            }  # fmt: skip
            if tuple(line[key] for key in IDENTITY) not in self.done:
                yield line


def solve(scene: Scene, captured: Capture, settings: SolveSettings | None = None) -> NormalMap:
    """The product's normal map of a capture."""
    return normals.solve_stack(
        captured.stack,
        captured.calibration,
        settings or SolveSettings(),
        normals.ObjectPlace(captured.rough_depth_m, silhouette=scene.truth.object),
    )


class SceneRun:
    """Solves of one scene; the pilot of each azimuth is solved once."""

    def __init__(self, scene: Scene, run: Plan) -> None:
        self.scene, self.run, self.fault = scene, run, faults.named(run.fault)
        self._pilots: dict[int, tuple[np.ndarray, Capture, NormalMap]] = {}

    def positions(self, line: Line) -> tuple[np.ndarray, float]:
        """Positions of all lights of a line, and the plan's forecast of σ, NaN without a plan."""
        pattern, count, azimuth = str(line["pattern"]), int(str(line["lights"])), int(str(line["azimuth"]))
        if pattern not in PLANNED:
            return patterns.fixed(pattern, self.scene, count, azimuth, self.run.azimuths), float("nan")
        first, captured, solved = self._pilot(azimuth)
        if pattern == "oracle":
            solved = patterns.oracle(self.scene, solved, captured)
        if count <= len(first):
            return first, float("nan")
        plan = patterns.planned(self.scene, solved, captured, count, azimuth)
        return np.concatenate([first, plan.positions]), plan.predicted_sigma_deg

    def _pilot(self, azimuth: int) -> tuple[np.ndarray, Capture, NormalMap]:
        if azimuth not in self._pilots:
            first = patterns.pilot_lights(self.scene, azimuth, self.run.azimuths)
            captured = capture(self.scene, first, azimuth, self.fault)
            self._pilots[azimuth] = first, captured, solve(self.scene, captured)
        return self._pilots[azimuth]

    def solved(self, line: Line, solver: Callable[[Scene, Capture], NormalMap] = solve) -> Line:
        """One line's grades, or in `error` a refusal of planner or solver.

        `solver` solves the line's capture; plans are made from pilots that the product has solved.
        """
        start = time.monotonic()
        true = self.scene.truth
        material: Line = {"material": str(self.scene.reflectance), "scatter_mm": 1e3 * self.scene.reflectance.scatter_m}
        try:
            positions, predicted = self.positions(line)
            captured = capture(self.scene, positions, int(str(line["azimuth"])), self.fault)
            planning = time.monotonic() - start
            if self.run.solver == "ls":
                mapped = grading.least_squares(
                    captured.stack, captured.calibration, captured.rough_depth_m, true.object
                )
                return line | material | grading.errors(mapped, true.object, true)
            start = time.monotonic()
            with trials.recorded() as looked_at:
                normal_map = solver(self.scene, captured)
            seconds = time.monotonic() - start
        except RigError as error:
            return line | material | {"error": f"{error.code}: {error}"}
        scalars = {key: value for key, value in normal_map.notes.items() if isinstance(value, str | int | float | bool)}
        error = np.log(normal_map.intensity_factors) - captured.log_intensity
        return (
            line
            | material
            | grading.errors(normal_map.normals, normal_map.mask, true)
            | grading.sigma(normal_map, true)
            | looked_at.line()
            | {
                "predicted_sigma": predicted,
                "intensity_error": float(np.std(error)),
                "findings": [[finding.kind, finding.corrected] for finding in normal_map.findings],
                "noise": {name: float(value) for name, value in normal_map.noise.items()},
                "notes": scalars,
                "seconds": round(seconds, 3),
                "planning_seconds": round(planning, 3),
            }
        )


def drawn(run: Plan, family: str, seed: int) -> Scene:
    """One of the run's scenes; report seeds are refused unless it is a report's run."""
    with scenes.report_seeds() if run.report else nullcontext():
        return scenes.scene(family, seed, run.reflectance)


def run_scene(run: Plan, family: str, seed: int) -> int:
    """Solves one scene's missing lines and appends them to the run's file; returns their number."""
    lines = list(run.of_scene(family, seed))
    if not lines:
        return 0
    of_scene = SceneRun(drawn(run, family, seed), run)
    for line in lines:
        append(run.out, of_scene.solved(line))
    return len(lines)


def run_all(run: Plan, jobs: int) -> int:
    """Solves all scenes in `jobs` processes; returns the number of added lines."""
    return over_scenes(partial(run_scene, run), run.families, run.seeds, jobs)


def over_scenes(work: Callable[[str, int], int], families: Sequence[str], seeds: Sequence[int], jobs: int) -> int:
    """Calls `work` for each family and seed, in `jobs` processes; returns the sum of its results."""
    pairs = list(itertools.product(seeds, families))
    if jobs == 1:
        return sum(work(family, seed) for seed, family in pairs)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        return sum(one.result() for one in [pool.submit(work, family, seed) for seed, family in pairs])


def append(path: Path, line: Line) -> None:
    """Appends a JSON line, undivided even if other processes write to the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(json.dumps(line) + "\n")


def read(path: Path) -> list[Line]:
    """The lines of a run's file; none if there is no file."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]


def done(lines: Sequence[Line], identity: Sequence[str] = IDENTITY) -> frozenset[tuple[object, ...]]:
    """The solves that the lines hold, each identified by the values of its `identity` keys."""
    return frozenset(tuple(line.get(key) for key in identity) for line in lines)
