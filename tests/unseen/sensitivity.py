"""Sensitivity of error and σ to halving and doubling each tuned number: the same captures, solved with one changed.

A number is changed by replacing its module's frozen `SETTINGS`. Captures whose unchanged solve does not read the number
are not solved again, because nothing changes there. One JSON line for each solve names number and factor; a run
continues where an earlier one with the same file stopped.
"""

import importlib
import itertools
import json
import math
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from acquisition.models.result import NormalMap
from tests import tuned_numbers
from tests.tuned_numbers import Number
from tests.unseen import reports, run, stages
from tests.unseen.captures import Capture
from tests.unseen.run import IDENTITY, Line, Plan, SceneRun
from tests.unseen.scenes import Scene
from tests.unseen.stages import Patch, Stage

FACTORS = {"halved": 0.5, "doubled": 2.0}
CHANGED = (*IDENTITY, "number", "change")
"""Keys that identify one solve and the change."""

CAPTURES = "turned:40,relief:40,machined:45,vessel:41,cluster:21,blob:42,knot:22,sheet:21"
"""One capture of each family, each solved in a few seconds: Lambertian, rough, glossy and translucent ones."""

RATIOS = ("share", "cosine", "probability", "quantile", "of the peak", "of the images")
"""Units of numbers that cannot exceed 1."""

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "sensitivity.json"
KEYS = {"error": "within_78_deg.mean", "rms": "rms"}


def named(names: str) -> list[Number]:
    """The tuned numbers of solver and shared photometry (`all`), of the `planner`, of named modules, or single ones as
    `module.name`. Raises ValueError for an unknown name."""
    found = tuned_numbers.settings()
    if names in ("all", "planner"):
        return [one for one in found if of_planner(one) == (names == "planner")]
    asked = set(names.split(","))
    chosen = [one for one in found if asked & {one.module, one.key}]
    if missing := asked - {one.module for one in chosen} - {one.key for one in chosen}:
        raise ValueError(f"there is no tuned number {', '.join(sorted(missing))}")
    return chosen


def of_planner(number: Number) -> bool:
    """Whether the number belongs to the planner, so that solves do not read it."""
    return _module(number).__name__.startswith("acquisition.plan.")


def scaled(value: Any, factor: float, unit: str) -> Any:
    """A setting times a factor: each member of tuples and dataclasses, integers by at least 1, ratios up to 1."""
    if factor == 1:
        return value
    if isinstance(value, tuple):
        return tuple(scaled(member, factor, unit) for member in value)
    if is_dataclass(value):
        return replace(value, **{one.name: scaled(getattr(value, one.name), factor, unit) for one in fields(value)})  # type: ignore[type-var]
    if isinstance(value, int):
        return max(0, min(round(value * factor), value - 1)) if factor < 1 else max(round(value * factor), value + 1)
    bounded = unit in RATIOS and value <= 1
    return min(value * factor, 1.0) if bounded else value * factor


def solve(captures: Sequence[tuple[str, int]], lights: int, numbers: Sequence[Number], out: Path) -> int:
    """Does the solves missing in the file, unchanged and with each number halved and doubled; returns their number.

    Numbers that modules read while they are imported are left out, because their uses would not see another value.
    """
    plans = [Plan((family,), (seed,), (lights,), ("two-rings",), 1, out) for family, seed in captures]
    drawn = [SceneRun(run.drawn(one, one.families[0], one.seeds[0]), one) for one in plans]
    wanted = [line for one in plans for line in one.of_scene(one.families[0], one.seeds[0])]
    known, commit, added = run.read(out), reports.commit(), 0

    def add(of_scene: SceneRun, line: Line, stage: Stage | None) -> None:
        nonlocal added
        if run.done([line], CHANGED) <= run.done(known, CHANGED):
            return
        with reading() as read:
            solved = of_scene.solved(line, partial(solve_with, stage))
        solved |= {"commit": commit} | ({"read": sorted(read)} if stage is None else {})
        run.append(out, solved)
        known.append(solved)
        added += 1

    for of_scene, line in zip(drawn, wanted, strict=True):
        add(of_scene, line | {"number": None, "change": None}, None)
    at_import = tuned_numbers.set_at_import()
    for number, (change, factor) in itertools.product(numbers, FACTORS.items()):
        if number.key not in at_import:
            stage = Stage(number.key, change, (changed(number, factor),))
            for of_scene, line in zip(drawn, wanted, strict=True):
                if number.key in read_by(known, line):
                    add(of_scene, line | {"number": number.key, "change": change}, stage)
    return added


def solve_with(stage: Stage | None, scene: Scene, captured: Capture) -> NormalMap:
    """The product's normal map with a number changed."""
    if stage is None:
        return run.solve(scene, captured)
    with stages.off(stage):
        return run.solve(scene, captured)


def changed(number: Number, factor: float) -> Patch:
    """The settings of a number's module with the number times a factor."""
    module = _module(number)
    return Patch(module, "SETTINGS", replace(module.SETTINGS, **{number.name: value(number, factor)}))


def value(number: Number, factor: float) -> Any:
    """A number's value times a factor."""
    return scaled(getattr(_module(number).SETTINGS, number.name), factor, number.unit)


class _Recorder:
    """Settings that record which of their fields are read."""

    def __init__(self, settings: object, module: str, read: set[str]) -> None:
        self._settings, self._module, self._read = settings, module, read

    def __getattr__(self, name: str) -> object:
        self._read.add(f"{self._module}.{name}")
        return getattr(self._settings, name)


@contextmanager
def reading() -> Generator[set[str]]:
    """The numbers, as `module.name`, that are read within the context, except those compiled into kernels."""
    read: set[str] = set()
    modules = {one.module: _module(one) for one in tuned_numbers.settings()}
    patches = [Patch(module, "SETTINGS", _Recorder(module.SETTINGS, name, read)) for name, module in modules.items()]
    with stages.off(Stage("", "", tuple(patches))):
        yield read


def read_by(lines: Iterable[Line], capture: Line) -> list[str]:
    """The numbers that a capture's unchanged solve read."""
    same = run.done([capture])
    return next((line["read"] for line in lines if "read" in line and run.done([line]) == same), [])  # type: ignore[return-value]


def moved(lines: Sequence[Line], numbers: Sequence[Number]) -> dict[str, Any]:
    """The figures on the page of tuned numbers: changes of error and rms e/σ by each number, or why there is none."""
    good = [line for line in lines if "error" not in line]
    base = [line for line in good if line["number"] is None]
    at_import = tuned_numbers.set_at_import()
    shown: dict[str, dict[str, Any]] = {}
    for number in numbers:
        touched = [line for line in base if number.key in line["read"]]  # type: ignore[operator]
        if number.key in at_import:
            shown[number.key] = {"not measured": "read while modules are imported"}
        elif not touched:
            shown[number.key] = {"not measured": "no capture reads it"}
        else:
            shown[number.key] = {"captures": len(touched)} | {
                change: figures for change in FACTORS if (figures := _ratios(good, base, number.key, change))
            }
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commits": sorted({str(line["commit"]) for line in lines}),
        "captures": [f"{line['family']} {line['seed']}, {line['material']}" for line in base],
        "numbers": shown,
    }


def _ratios(lines: Sequence[Line], base: Sequence[Line], number: str, change: str) -> dict[str, list[float]]:
    """Geometric mean over captures of each figure's ratio to the unchanged solve, and its standard error; empty if a
    capture that reads the number is not solved."""
    solved = {run.done([line]): line for line in lines if (line["number"], line["change"]) == (number, change)}
    pairs = [(solved.get(run.done([one])), one) for one in base]
    if any(line is None and number in one["read"] for line, one in pairs):  # type: ignore[operator]
        return {}
    out: dict[str, list[float]] = {}
    for name, key in KEYS.items():
        logs = [math.log(float(str((line or one)[key])) / float(str(one[key]))) for line, one in pairs]
        out[name] = [round(math.exp(np.mean(logs)), 4), round(float(np.std(logs, ddof=1) / math.sqrt(len(logs))), 4)]
    return out


def write(figures: dict[str, Any], section: str = "solver") -> None:
    """Writes a section of the figures from which the page of tuned numbers is generated.

    Figures of other numbers on the same captures are kept.
    """
    known = json.loads(PAGE.read_text(encoding="utf-8")) if PAGE.exists() else {}
    before = known.get(section, {})
    if "captures" in figures and figures["captures"] == before.get("captures"):
        commits = sorted({*before["commits"], *figures["commits"]})
        figures = figures | {"commits": commits, "numbers": before["numbers"] | figures["numbers"]}
    PAGE.write_text(json.dumps(known | {section: figures}, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _module(number: Number) -> ModuleType:
    relative = tuned_numbers.paths()[number.module].relative_to(tuned_numbers.ACQUISITION.parent).with_suffix("")
    return importlib.import_module(".".join(relative.parts))
