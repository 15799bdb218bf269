"""Ablation of the near solver: the same captures are solved with one stage off at a time, and with all stages on.

A run writes one JSON line for each solve, as the bench's `run` does, with the key `stage`: the name of the stage that
is off, or none. It continues where an earlier run with the same file stopped. Figures are paired by scene: the error
without a stage divided by that with it, and the ratio of error to σ without and with it.
"""

import itertools
import textwrap
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from acquisition.models.result import NormalMap, SolveSettings
from tests.unseen import reports, run, stages, tables
from tests.unseen.captures import Capture
from tests.unseen.run import IDENTITY, Line, Plan, SceneRun
from tests.unseen.scenes import Scene
from tests.unseen.stages import Captures, Stage

WITH_STAGE = (*IDENTITY, "stage")
"""Keys that identify one solve and the stage that is off."""

BY_NAME = {stage.name: stage for stage in stages.STAGES}


def asked(plan: Plan, names: Sequence[str], family: str, seed: int) -> list[Line]:
    """One scene's solves, with all stages on and without each named stage, on the captures that the stages require."""
    lines: list[Line] = []
    for captures in dict.fromkeys(BY_NAME[name].captures for name in names):
        of_these = [name for name in names if BY_NAME[name].captures == captures]
        own = plan if captures is None else replace(plan, reflectance=captures.reflectance, fault=captures.fault)
        if seed in _seeds(plan, captures):
            pairs = itertools.product(own.of_scene(family, seed), (None, *of_these))
            lines += [line | {"stage": name} for line, name in pairs]
    return lines


def _seeds(plan: Plan, captures: Captures | None) -> Sequence[int]:
    return plan.seeds if captures is None or not captures.seeds else captures.seeds


def all_seeds(plan: Plan, names: Sequence[str]) -> list[int]:
    """The plan's seeds, and those that stages require."""
    return sorted({seed for name in names for seed in _seeds(plan, BY_NAME[name].captures)})


def of_plan(plan: Plan, names: Sequence[str]) -> list[Line]:
    """The requested solves that the plan's file holds."""
    pairs = itertools.product(plan.families, all_seeds(plan, names))
    wanted = run.done([line for family, seed in pairs for line in asked(plan, names, family, seed)], WITH_STAGE)
    return [line for line in run.read(plan.out) if run.done([line], WITH_STAGE) <= wanted]


def run_scene(plan: Plan, names: Sequence[str], family: str, seed: int) -> int:
    """Does a scene's missing solves and appends them to the plan's file; returns their number."""
    known = run.done(run.read(plan.out), WITH_STAGE)
    left = [line for line in asked(plan, names, family, seed) if not run.done([line], WITH_STAGE) <= known]
    if not left:
        return 0
    commit = reports.commit()
    for (reflectance, fault), lines in itertools.groupby(left, lambda line: (line["reflectance"], line["fault"])):
        own = replace(plan, reflectance=_text(reflectance), fault=_text(fault))
        of_scene = SceneRun(run.drawn(own, family, seed), own)
        for line in lines:
            stage = None if line["stage"] is None else BY_NAME[str(line["stage"])]

            def solver(scene: Scene, captured: Capture, stage: Stage | None = stage) -> NormalMap:
                return solve_without(stage, scene, captured)

            run.append(plan.out, of_scene.solved(line, solver) | {"commit": commit})
    return len(left)


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def solve_without(stage: Stage | None, scene: Scene, captured: Capture) -> NormalMap:
    """The product's normal map of a capture without a stage."""
    if stage is None:
        return run.solve(scene, captured)
    with stages.off(stage):
        return run.solve(scene, captured, stage.settings)


def run_all(plan: Plan, names: Sequence[str], jobs: int) -> int:
    """Solves all scenes with all stages and without each named one, in `jobs` processes; returns how many solves."""
    return run.over_scenes(partial(run_scene, plan, names), plan.families, all_seeds(plan, names), jobs)


def all_tables(lines: Sequence[Line], grading: str) -> str:
    """Tables in Markdown: over all families, then error, rms e/σ and P(e < σ) by family; most useful stages first."""
    good, failed = _by_stage(lines, refused=False), _by_stage(lines, refused=True)
    base = good.pop(None, [])
    if not base or not good:
        return "There is no pair of solves without and with a stage yet."
    names = sorted(good, key=lambda name: -tables.geometric(_ratios(good[name], base, grading))[0])
    families = list(dict.fromkeys(str(line["family"]) for line in base))
    parts = [
        "## Over all families",
        _markdown(
            ["without", "error without / with", "rms e/σ without → with", "P(e < σ) without → with", "scenes"],
            [
                [
                    str(name),
                    tables.with_error(*tables.geometric(_ratios(good[name], base, grading))),
                    _change(good[name], base, "rms"),
                    _change(good[name], base, "within_1"),
                    str(len(_ratios(good[name], base, grading))),
                ]
                for name in names
            ],
        ),
    ]

    def of(family: str, some: Sequence[Line]) -> list[Line]:
        return [line for line in some if line["family"] == family]

    def by_family(title: str, cell: Callable[[Sequence[Line], Sequence[Line]], str]) -> None:
        rows = [[str(name), *(cell(of(one, good[name]), of(one, base)) for one in families)] for name in names]
        parts.extend([title, _markdown(["without", *families], rows)])

    def ratio(some: Sequence[Line], with_it: Sequence[Line]) -> str:
        return tables.with_error(*tables.geometric(_ratios(some, with_it, grading)))

    by_family("## Error without / with, by family", ratio)
    by_family("## rms e/σ without → with, by family", lambda some, with_it: _change(some, with_it, "rms"))
    by_family("## P(e < σ) without → with, by family", lambda some, with_it: _change(some, with_it, "within_1"))
    if failed:
        reasons = [f"{name or 'all stages on'}: {len(some)} ({some[0]['error']})" for name, some in failed.items()]
        parts.append("Refused: " + "; ".join(reasons) + ".")
    return "\n\n".join(parts)


def page(command: str, lines: Sequence[Line], grading: str) -> str:
    """The documentation's page of the tables, with command, date, commit, and the effect of each switch."""
    commits = " and ".join(sorted({f"`{line.get('commit', 'unknown')}`" for line in lines}))
    scenes = len({(line["family"], line["seed"]) for line in lines})
    switches = _markdown(
        ["stage that is off", "then", "switch", "captures"],
        [[stage.name, stage.without, _switch(stage), str(stage.captures or "all")] for stage in stages.STAGES],
    )
    when = datetime.now(UTC).strftime("%Y-%m-%d")
    origin = (
        f"Written by `python -m tests.unseen {command}` on {when}, solver of commit {commits}, {scenes} scenes "
        f"({_materials(lines)}). Each such run writes it anew; edit `tests/unseen/ablation.py` instead."
    )
    words = [
        textwrap.fill(text, 120, break_on_hyphens=False, break_long_words=False)
        for text in (origin, INTRODUCTION.format(grading=GRADING_WORDS[grading]), NOT_SWITCHED)
    ]
    return f"""# What each stage of the near solver buys

{words[0]}

{words[1]}

{all_tables(lines, grading)}

## What off means

{switches}

{words[2]}
"""


def _materials(lines: Sequence[Line]) -> str:
    """The number of scenes of each kind of reflectance."""
    kinds = Counter(
        kind for *_, kind in {(n["family"], n["seed"], str(n.get("material")).split(":")[0]) for n in lines}
    )
    return ", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items()))


GRADING_WORDS = {
    "one_surface": "pixels of one surface",
    "within_78_deg": "pixels within 78° of the viewing ray, eroded by one",
    "object": "all object pixels",
}

INTRODUCTION = """The same captures of random, path-traced objects (`tests/unseen`) are solved with one stage switched
off at a time, all others on. An error without / with of 1.10 says that the stage takes a tenth off the error; below 1
the captures are solved better without it. Means are geometric, over the scenes of a family and then over families; ± is
the standard error over scenes (bootstrap), and a stage whose ± reaches 1 has not been shown to matter on these scenes.
Errors are means over {grading}. rms e/σ and P(e < σ), arithmetic means over solves, are of the same pixels without
those that are marked doubtful; ideal are 1 and 0.63. Stages that only some captures call for are looked at on
these, with a reflectance, a fault or seeds of their own (last table). Stages work on one another: what one buys depends
on the others being on, and the figures do not add up."""

NOT_SWITCHED = """Not among them is the estimate of the sensor's noise (`sensor_estimate` and `pixel_noise` of
`acquisition.normals.uncertainty`): the bench states the sensor's true noise, and neither is reached. One that changes
few errors here serves others: noise from residuals σ where the model is wrong, the finding `lamps`, and the choice of
the solver under many distant lights."""


def write(path: Path, command: str, lines: Sequence[Line], grading: str) -> None:
    """Writes the page."""
    path.write_text(page(command, lines, grading), encoding="utf-8")


def _switch(stage: Stage) -> str:
    changed = [f"`{patch.target}`" for patch in stage.patches]
    if stage.settings is not None:
        usual = SolveSettings().model_dump()
        changed += [f"`{name}` {value}" for name, value in stage.settings.model_dump().items() if value != usual[name]]
    return ", ".join(changed)


def _by_stage(lines: Sequence[Line], *, refused: bool) -> dict[object, list[Line]]:
    groups: dict[object, list[Line]] = defaultdict(list)
    for line in lines:
        if ("error" in line) == refused:
            groups[line.get("stage")].append(line)
    return groups


def _ratios(some: Sequence[Line], base: Sequence[Line], grading: str) -> dict[tables.Cell, float]:
    """Each scene's error divided by that of `base`, over captures that both have solved."""
    common = run.done(some) & run.done(base)
    pair = [[line for line in group if run.done([line]) <= common] for group in (some, base)]
    return tables.paired(*(tables.by_scene(group, grading, lambda _: True) for group in pair))


def _change(some: Sequence[Line], base: Sequence[Line], key: str) -> str:
    """Means of a figure without → with, over captures that both have: first over solves, then over families."""
    common = run.done([line for line in some if key in line]) & run.done([line for line in base if key in line])
    if not common:
        return ""
    means: list[float] = []
    for group in (some, base):
        by_family: dict[object, list[float]] = defaultdict(list)
        for line in group:
            if run.done([line]) <= common:
                by_family[line["family"]].append(float(str(line[key])))
        means.append(float(np.mean([np.mean(values) for values in by_family.values()])))
    return f"{means[0]:.2f} → {means[1]:.2f}"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    written = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(row) + " |" for row in written)
