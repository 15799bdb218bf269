"""The bench on unseen shapes: `python -m tests.unseen run|table|fit-sigma|ablate|sensitivity|dome|guard|mosaic`.

    python -m tests.unseen run --families all --seeds 0:6 --lights 6,8,12,20 \
        --patterns two-rings,planned,ring-35,drbohlav,random,oracle --azimuths 4 --jobs 2 --out build/unseen/run.jsonl
    python -m tests.unseen run --fault all --lights 10 --azimuths 1 --reflectance lambert --out build/unseen/fault.jsonl
    python -m tests.unseen table build/unseen/run.jsonl [--against OTHER.jsonl | --trials]
    python -m tests.unseen fit-sigma --families all --seeds 0:10 --lights 6,8,12,20 --jobs 2 --out build/unseen/sigma
    python -m tests.unseen ablate --families all --seeds 0:4 --lights 8 --write docs/explanation/ablation.md
    python -m tests.unseen sensitivity --numbers all|planner|own --write
    python -m tests.unseen dome --families all --seeds 0:2 --choices 200
    python -m tests.unseen guard --out build/guard [--against FOLDER OF ANOTHER CHECKOUT]
    python -m tests.unseen mosaic --families all --seeds 0:2 --lights 10
"""

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # processes share the cores, one scene each
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2

from hardware_sim import families
from tests.unseen import (
    ablation,
    dome,
    faults,
    guard,
    mosaic,
    own_benches,
    plan_sensitivity,
    reports,
    run,
    sensitivity,
    sigma_fit,
    tables,
)
from tests.unseen.patterns import PATTERNS
from tests.unseen.scenes import GRADINGS, PIXELS


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.unseen", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="solve scenes, one JSON line each solve")
    _add_captures(runs, azimuths=4, out=Path("build/unseen/run.jsonl"))
    runs.add_argument("--solver", choices=("product", "ls"), default="product", help="ls: plain least squares")
    ablate = commands.add_parser("ablate", help="solve the same captures without each stage of the solver, and compare")
    _add_captures(ablate, azimuths=1, out=Path("build/unseen/ablation.jsonl"))
    ablate.add_argument("--stages", default="all", help=f"all, or of {', '.join(ablation.BY_NAME)}")
    ablate.add_argument("--grading", default="within_78_deg", choices=GRADINGS)
    ablate.add_argument("--write", type=Path, default=None, help="the documentation's page, written anew")
    fitted = commands.add_parser("fit-sigma", help="fit the constants of σ's components to errors on design seeds")
    _add_captures(fitted, azimuths=1, out=Path("build/unseen/sigma"))
    fitted.add_argument("--tail", type=float, default=sigma_fit.TAIL, help="degrees of freedom of the errors' tail")
    shown = commands.add_parser("table", help="tables of a run's lines")
    shown.add_argument("file", type=Path)
    shown.add_argument("--against", type=Path, default=None, help="an older run: paired ratios to it")
    shown.add_argument("--grading", default="within_78_deg", choices=GRADINGS)
    shown.add_argument("--trials", action="store_true", help="what model selection looked at, in place of errors")
    domes = commands.add_parser("dome", help="replay a dome of 96 lamps: its plan against random choices")
    _add_scenes(domes, out=Path("build/unseen/dome.jsonl"))
    domes.add_argument("--count", type=int, default=8, help="images in all, pilot included")
    domes.add_argument("--pixels", type=int, default=PIXELS, help="side of the images; with 72 a solve takes a third")
    domes.add_argument("--choices", type=int, default=200, help="random choices of each kind")
    domes.add_argument(
        "--kinds", default=",".join(dome.KINDS), help="of any lamps; of the pilot's and any further ones"
    )
    guarded = commands.add_parser("guard", help="solve a fixed set of captures, and compare with another checkout's")
    guarded.add_argument("--out", type=Path, default=Path("build/guard"))
    guarded.add_argument("--against", type=Path, default=None, help="folder of the other checkout's results")
    guarded.add_argument("--cases", default="all", help=f"all, or of {'; '.join(guard.CASES)}")
    guarded.add_argument("--within-deg", type=float, default=0.0, help="mean rotation of normals that passes")
    guarded.add_argument(
        "--within-share", type=float, default=0.0, help="mean change of σ, and of the plan, that passes"
    )
    sites = commands.add_parser("mosaic", help="a mosaic sensor against a monochrome one of the same noise")
    _add_scenes(sites, out=Path("build/unseen/mosaic.jsonl"))
    sites.add_argument("--lights", default="10", help="numbers of images")
    moved = commands.add_parser("sensitivity", help="halve and double each tuned number")
    moved.add_argument(
        "--numbers",
        default="all",
        help="all (the solver's), planner, own (with own scenes), or modules and module.name, by commas",
    )
    moved.add_argument("--captures", default=sensitivity.CAPTURES, help="family:seed, by commas")
    moved.add_argument("--lights", type=int, default=8)
    moved.add_argument("--out", type=Path, default=Path("build/unseen/sensitivity.jsonl"))
    moved.add_argument("--write", action="store_true", help="the figures of the page of tuned numbers, written anew")
    asked = parser.parse_args(arguments)
    command = " ".join(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    if asked.command in (others := {"table": _tables, "guard": _guard, "sensitivity": _sensitivity}):
        return others[asked.command](asked)
    names = families.NAMES if asked.families == "all" else tuple(asked.families.split(","))
    if unknown := set(names) - set(families.NAMES):
        parser.error(f"there is no {', '.join(sorted(unknown))}")
    apart = {"dome": _dome, "mosaic": _mosaic}.get(asked.command)
    if apart is not None:
        return apart(asked, names, command)
    wrong = _faults(asked.fault)
    plan = run.Plan(
        families=names,
        seeds=_numbers(asked.seeds),
        lights=_numbers(asked.lights),
        patterns=asked.patterns.split(","),
        azimuths=asked.azimuths,
        out=asked.out,
        fault=wrong[0],
        reflectance=asked.reflectance,
        solver=asked.solver if asked.command == "run" else "product",
        report=asked.report,
        done=run.done(run.read(asked.out)) if asked.command == "run" else frozenset(),
    )
    if unknown := set(plan.patterns) - set(PATTERNS) | set(map(str, wrong)) - {"None", *faults.ALL}:
        parser.error(f"there is no {', '.join(sorted(unknown))}")
    if asked.command != "run" and len(wrong) > 1:
        parser.error("several faults are for run")
    start = time.monotonic()
    if asked.command == "fit-sigma":
        if asked.report:
            parser.error("constants are fitted on design seeds only")
        sigma_fit.collect(plan, asked.out, asked.jobs)
        print(sigma_fit.summary(sigma_fit.read(asked.out), asked.tail))
        return 0
    if asked.command == "ablate":
        stages = list(ablation.BY_NAME) if asked.stages == "all" else asked.stages.split(",")
        if missing := set(stages) - set(ablation.BY_NAME):
            parser.error(f"there is no stage {', '.join(sorted(missing))}")
        added = ablation.run_all(plan, stages, asked.jobs)
        lines = ablation.of_plan(plan, stages)
        summary = ablation.all_tables(lines, asked.grading)
        print(summary)
        if asked.write is not None:
            ablation.write(asked.write, command, lines, asked.grading)
    else:
        added = sum(run.run_all(replace(plan, fault=fault), asked.jobs) for fault in wrong)
        summary = tables.all_tables(run.read(asked.out), "within_78_deg", None) if asked.report else ""
    print(f"{added} solves in {time.monotonic() - start:.0f} s -> {asked.out}")
    if asked.report:
        reports.write(command, summary)
    return 0


def _tables(asked: argparse.Namespace) -> int:
    if asked.trials:
        print(tables.selection_tables(run.read(asked.file)))
        return 0
    older = None if asked.against is None else run.read(asked.against)
    print(tables.all_tables(run.read(asked.file), asked.grading, older))
    return 0


def _guard(asked: argparse.Namespace) -> int:
    names = list(guard.CASES) if asked.cases == "all" else asked.cases.split(";")
    guard.solve(asked.out, names)
    if asked.against is None:
        return 0
    return 0 if guard.compare(asked.out, asked.against, names, asked.within_deg, asked.within_share) else 1


def _sensitivity(asked: argparse.Namespace) -> int:
    numbers = own_benches.numbers() if asked.numbers == "own" else sensitivity.named(asked.numbers)
    if not {one.key for one in numbers} - set(own_benches.BENCHES):
        own_benches.measure(numbers, asked.write)
        return 0
    numbers = [one for one in numbers if one.key not in own_benches.BENCHES]
    captures = [(family, int(seed)) for family, seed in (one.split(":") for one in asked.captures.split(","))]
    if all(map(sensitivity.of_planner, numbers)):
        figures = plan_sensitivity.page(captures, asked.lights, numbers)
        if asked.write:
            sensitivity.write(figures, "planner")
        return 0
    added = sensitivity.solve(captures, asked.lights, numbers, asked.out)
    print(f"{added} solves -> {asked.out}")
    if asked.write:
        sensitivity.write(sensitivity.moved(run.read(asked.out), numbers))
    return 0


def _dome(asked: argparse.Namespace, names: tuple[str, ...], command: str) -> int:
    replay = dome.Replay(
        families=names,
        seeds=_numbers(asked.seeds),
        count=asked.count,
        kinds=asked.kinds.split(","),
        choices=asked.choices,
        out=asked.out,
        reflectance=asked.reflectance,
        pixels=asked.pixels,
        report=asked.report,
        done=run.done(run.read(asked.out), dome.IDENTITY),
    )
    dome.run_all(replay, asked.jobs)
    summary = dome.table(run.read(asked.out), "within_78_deg")
    print(summary)
    if asked.report:
        reports.write(command, summary)
    return 0


def _mosaic(asked: argparse.Namespace, names: tuple[str, ...], command: str) -> int:
    work = partial(
        mosaic.run_scene, asked.out, _numbers(asked.lights), asked.reflectance or "lambert", asked.report
    )  # fmt: skip
    run.over_scenes(work, names, _numbers(asked.seeds), asked.jobs)
    summary = mosaic.table(run.read(asked.out))
    print(summary)
    if asked.report:
        reports.write(command, summary)
    return 0


def _add_scenes(command: argparse.ArgumentParser, out: Path) -> None:
    """Options that name scenes, and the file of lines."""
    command.add_argument("--families", default="all", help=f"all, or of {','.join(families.NAMES)}")
    command.add_argument("--seeds", default="0:3", help="FROM:TO (without TO), or a list")
    command.add_argument("--reflectance", default=None, help="lambert, oren-nayar:0.35, ggx:0.2, metal:0.3; else own")
    command.add_argument("--jobs", type=int, default=1)
    command.add_argument("--out", type=Path, default=out)
    command.add_argument(
        "--report", action="store_true", help="allow report seeds; written into tests/unseen/reports.md"
    )


def _add_captures(command: argparse.ArgumentParser, azimuths: int, out: Path) -> None:
    """Options that name captures, and the file of lines."""
    _add_scenes(command, out)
    command.add_argument("--lights", default="8", help="numbers of images, pilot included")
    command.add_argument("--patterns", default="two-rings", help=f"of {','.join(PATTERNS)}")
    command.add_argument("--azimuths", type=int, default=azimuths)
    command.add_argument("--fault", default=None, help=f"all, or of none,{','.join(sorted(faults.ALL))}")


def _faults(text: str | None) -> list[str | None]:
    """Names of faults, with None for a capture without one; `all` gives None and every fault."""
    if text == "all":
        return [None, *faults.ALL]
    return [None] if text is None else [None if name == "none" else name for name in text.split(",")]


def _numbers(text: str) -> list[int]:
    if ":" in text:
        first, last = text.split(":")
        return list(range(int(first), int(last)))
    return [int(part) for part in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
