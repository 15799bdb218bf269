"""The bench on unseen shapes: `python -m tests.unseen run …` and `python -m tests.unseen table FILE`.

    python -m tests.unseen run --families all --seeds 0:6 --lights 6,8,12,20 \
        --patterns two-rings,planned,ring-35,drbohlav,random,oracle --azimuths 4 --jobs 2 --out build/unseen/run.jsonl
    python -m tests.unseen table build/unseen/run.jsonl [--against OTHER.jsonl]
"""

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # processes share the cores, one scene each
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
from pathlib import Path

import cv2

from hardware_sim import families
from tests.unseen import faults, reports, run, tables
from tests.unseen.patterns import PATTERNS


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.unseen", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="solve scenes, one JSON line each solve")
    runs.add_argument("--families", default="all", help=f"all, or of {','.join(families.NAMES)}")
    runs.add_argument("--seeds", default="0:3", help="FROM:TO (without TO), or a list")
    runs.add_argument("--lights", default="8", help="numbers of images, pilot included")
    runs.add_argument("--patterns", default="two-rings", help=f"of {','.join(PATTERNS)}")
    runs.add_argument("--azimuths", type=int, default=4)
    runs.add_argument("--fault", choices=sorted(faults.ALL), default=None)
    runs.add_argument("--reflectance", default=None, help="lambert, oren-nayar:0.35, ggx:0.2, metal:0.3; else own")
    runs.add_argument("--solver", choices=("product", "ls"), default="product", help="ls: plain least squares")
    runs.add_argument("--jobs", type=int, default=1)
    runs.add_argument("--out", type=Path, default=Path("build/unseen/run.jsonl"))
    runs.add_argument("--report", action="store_true", help="allow report seeds; written into tests/unseen/reports.md")
    shown = commands.add_parser("table", help="tables of a run's lines")
    shown.add_argument("file", type=Path)
    shown.add_argument("--against", type=Path, default=None, help="an older run: paired ratios to it")
    shown.add_argument("--grading", default="within_78_deg", choices=("one_surface", "within_78_deg", "object"))
    asked = parser.parse_args(arguments)
    if asked.command == "table":
        older = None if asked.against is None else run.read(asked.against)
        print(tables.all_tables(run.read(asked.file), asked.grading, older))
        return 0
    cv2.setNumThreads(1)
    names = families.NAMES if asked.families == "all" else tuple(asked.families.split(","))
    plan = run.Plan(
        families=names,
        seeds=_numbers(asked.seeds),
        lights=_numbers(asked.lights),
        patterns=asked.patterns.split(","),
        azimuths=asked.azimuths,
        out=asked.out,
        fault=asked.fault,
        reflectance=asked.reflectance,
        solver=asked.solver,
        report=asked.report,
        done=run.done(run.read(asked.out)),
    )
    unknown = (set(names) - set(families.NAMES)) | (set(plan.patterns) - set(PATTERNS))
    if unknown:
        parser.error(f"there is no {', '.join(sorted(unknown))}")
    start = time.monotonic()
    added = run.run_all(plan, asked.jobs)
    print(f"{added} solves in {time.monotonic() - start:.0f} s -> {asked.out}")
    if asked.report:
        reports.write(" ".join(sys.argv[1:]), tables.all_tables(run.read(asked.out), "within_78_deg", None))
    return 0


def _numbers(text: str) -> list[int]:
    if ":" in text:
        first, last = text.split(":")
        return list(range(int(first), int(last)))
    return [int(part) for part in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
