"""Compares two checkouts' results on the same captures: a fixed set is solved, stored, and compared with another's.

    python -m tests.unseen guard --out /tmp/before                       # in the one checkout
    python -m tests.unseen guard --out /tmp/after --against /tmp/before  # in the other; fails if results differ

The set covers every entry point of the solver: a bench capture of each kind of reflectance and one with a fault, a
near-light folder, distant lights, a session of release 0.1, and a plan with its forecast. The captures are the bench's,
so both checkouts have the same images, unless one of them changes how they are drawn.
"""

import hashlib
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquisition.formats import folders
from acquisition.formats.folders import session_folder
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals import distant, near_light
from acquisition.runner.session_solve import solve_in_cell
from tests.acquisition.normals.distant import few_light_scenes
from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture, write_folder

RELEASE = Path(__file__).parents[1] / "data" / "release_0.1" / "sessions" / "20261121-190041-de2be6"
FLOOR_DEG = 1e-6


@dataclass(frozen=True)
class Result:
    """A case's result: normals (H, W, 3), σ and depth (H, W), error (H, W) in degrees, NaN where it is not graded, and
    positions and forecast of a plan, if there is one."""

    normals: np.ndarray
    sigma_deg: np.ndarray
    depth: np.ndarray
    error_deg: np.ndarray
    plan: np.ndarray

    @property
    def digest(self) -> str:
        """Hash of all arrays except the error."""
        parts = (self.normals, self.sigma_deg, self.depth, self.plan)
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()[:12]

    def figures(self) -> tuple[float, float, float]:
        """Mean error and σ, degrees, and rms e/σ over the graded pixels."""
        graded = np.isfinite(self.error_deg) & np.isfinite(self.sigma_deg) & (self.sigma_deg > 0)
        error, sigma = self.error_deg[graded], self.sigma_deg[graded]
        if not len(error):
            return float("nan"), float("nan"), float("nan")
        return float(error.mean()), float(sigma.mean()), float(np.sqrt(np.mean((error / sigma) ** 2)))


def _result(solved: NormalMap, truth: np.ndarray | None, graded: np.ndarray, plan: np.ndarray | None = None) -> Result:
    """The result of a solve, graded against normals (H, W, 3) at solved pixels of `graded`."""
    error = np.full(solved.mask.shape, np.nan)
    if truth is not None:
        cosine = np.clip(np.sum(solved.normals * truth, axis=-1), -1, 1)
        error = np.where(graded & solved.mask, np.degrees(np.arccos(cosine)), np.nan)
    return Result(solved.normals, solved.sigma_deg, solved.depth, error, np.zeros(0) if plan is None else plan)


def _bench(family: str, reflectance: str | None, pixels: int, fault: str | None = None) -> Result:
    scene = scenes.scene(family, 0, reflectance, pixels)
    captured = capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1), 0, faults.named(fault))
    return _result(run.solve(scene, captured), scene.truth.normals, scene.truth.within_78_deg)


def _planned(family: str, pixels: int) -> Result:
    """The pilot's result and the plan made from it."""
    scene = scenes.scene(family, 0, None, pixels)
    captured = capture(scene, patterns.pilot_lights(scene, 0, 1))
    solved = run.solve(scene, captured)
    chosen = patterns.planned(scene, solved, captured, 8, 0)
    plan = np.append(chosen.positions.ravel(), chosen.predicted_sigma_deg)
    return _result(solved, scene.truth.normals, scene.truth.within_78_deg, plan)


def _near_folder(family: str, pixels: int) -> Result:
    scene = scenes.scene(family, 0, None, pixels)
    captured = capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1))
    with tempfile.TemporaryDirectory() as scratch:
        folder, decoded = Path(scratch) / "capture", Path(scratch) / "decoded"
        decoded.mkdir()
        write_folder(folder, scene, captured)
        solved = near_light.solve(folders.read(folder, decoded), SolveSettings())
    return _result(solved, scene.truth.normals, scene.truth.within_78_deg)


def _distant(shape: str, material: str, lights: int) -> Result:
    scene = few_light_scenes.scene(shape, material, lights, size=64)
    return _result(distant.solve(scene.image_set()), scene.normals, scene.mask)


def _session() -> Result:
    read = session_folder.read(RELEASE)
    observations = read.observations(1)
    solved = solve_in_cell(observations, read.cell, read.calibration, SolveSettings())
    return _result(solved, None, solved.mask)


CASES: dict[str, Callable[[], Result]] = {
    "relief, Lambert": lambda: _bench("relief", "lambert", 96),
    "machined, gloss": lambda: _bench("machined", "ggx:0.25", 72),
    "vessel, Oren-Nayar": lambda: _bench("vessel", "oren-nayar:0.35", 64),
    "sheet, metal": lambda: _bench("sheet", "metal:0.3", 36),
    "turned, ambient light": lambda: _bench("turned", "lambert", 64, "ambient:0.1"),
    "knot, planned": lambda: _planned("knot", 72),
    "cluster, near folder": lambda: _near_folder("cluster", 72),
    "wrinkled, 12 distant": lambda: _distant("wrinkled", "matt", 12),
    "wrinkled, 20 distant": lambda: _distant("wrinkled", "glossy", 20),
    "session of release 0.1": _session,
}


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name.replace(' ', '_').replace(',', '')}.npz"


def solve(folder: Path, names: list[str]) -> None:
    """Solves cases and stores their results in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        start = time.monotonic()
        one = CASES[name]()
        store(folder, name, one)
        error, sigma, rms = one.figures()
        seconds = time.monotonic() - start
        print(f"{name:24} {one.digest}  error {error:6.3f}  σ {sigma:6.3f}  rms e/σ {rms:5.2f}  {seconds:5.1f} s")


def store(folder: Path, name: str, result: Result) -> None:
    """Stores the result of a case."""
    np.savez(_path(folder, name), **vars(result))


def read(folder: Path, name: str) -> Result:
    """A stored result."""
    with np.load(_path(folder, name)) as stored:
        return Result(**dict(stored))


def differences(one: Result, other: Result) -> tuple[float, float, float]:
    """Mean rotation of the normals, degrees; mean relative change of σ over solved pixels; greatest change of the plan,
    m or degrees. All are infinite if shapes or solved pixels differ."""
    solved, also = (np.isfinite(each.sigma_deg) for each in (one, other))
    if one.plan.shape != other.plan.shape or solved.shape != also.shape or np.any(solved != also):
        return float("inf"), float("inf"), float("inf")
    chord = np.linalg.norm(one.normals[solved].astype(float) - other.normals[solved], axis=-1)
    turned = np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))
    sigma = np.abs(one.sigma_deg / np.maximum(other.sigma_deg, FLOOR_DEG) - 1)[solved]
    moved = np.nanmax(np.abs(one.plan - other.plan), initial=0.0)
    return float(turned.mean()), float(sigma.mean()), float(moved)


def compare(folder: Path, against: Path, names: list[str], within_deg: float, within_share: float) -> bool:
    """Prints how two folders' results differ; returns whether all keep the bounds on rotation, and on σ and plan."""
    sound = True
    for name in names:
        one, other = read(folder, name), read(against, name)
        if one.digest == other.digest:
            print(f"{name:24} identical")
            continue
        turned, sigma, moved = differences(one, other)
        sound &= turned <= within_deg and sigma <= within_share and moved <= within_share
        figures = "; ".join(
            f"{word} {new:.4f} ({old:.4f})"
            for word, new, old in zip(("error", "σ", "rms e/σ"), one.figures(), other.figures(), strict=True)
        )
        print(f"{name:24} normals turned {turned:.2g}°, σ by {sigma:.2g} of it, plan by {moved:.2g}; {figures}")
    return sound
