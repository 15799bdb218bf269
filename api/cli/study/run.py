"""The whole study: its parts in two processes, and what they found as values for the page and for programs.

How much is drawn is fixed, never by the clock, so that a seed gives the same figures on every machine.
"""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from acquisition.models.errors import ErrorCode, RigError
from api.cli.study import error_curves, page, paper_criterion, simulated_scene, three_images
from api.cli.study.error_curves import Draws, Scale
from api.cli.study.paper_criterion import Errata, Placement
from api.cli.study.study_result import Study
from api.cli.study.three_images import Row

PROCESSES = 2
SMALL_PIXELS = 128

T = TypeVar("T")


FULL = Scale(
    pixels=simulated_scene.PIXELS,
    objects=simulated_scene.OBJECTS,
    glossy_objects=simulated_scene.OBJECTS,
    matt=Draws(
        rivals={3: 1, 6: 1, 8: 6, 12: 6, 20: 6, 24: 1}, compared={3: 1, 8: 6, 24: 1}, others={3: 1, 8: 1, 24: 1}
    ),
    glossy=Draws(rivals={8: 6, 12: 6, 20: 1}, compared={8: 1, 12: 1}, others={8: 1, 12: 1}),
    table_objects=("figure", "vase", "bumps"),
    table_draws=12,
)
QUICK = Scale(
    pixels=SMALL_PIXELS,
    objects=("vase", "relief", "figure"),
    glossy_objects=("vase",),
    matt=Draws(rivals={3: 1, 8: 1, 12: 1}, compared={8: 1}, others={8: 1}),
    glossy=Draws(rivals={8: 1}, compared={8: 1}, others={8: 1}),
    table_objects=("figure", "vase"),
    table_draws=2,
)


def run(seed: int, out: Path, *, quick: bool) -> dict[str, Any]:
    """Runs the study, writes `study.html` and `study.json` into `out`, and returns what the latter holds.

    Raises RigError service.fault when a process of the study dies.
    """
    out.mkdir(parents=True, exist_ok=True)
    found = measure(seed, QUICK if quick else FULL, quick=quick)
    told = summary(found)
    page.write(out / "study.html", found, told)
    page.write_json(out / "study.json", {**told, "samples": [asdict(sample) for sample in found.samples]})
    return told


def measure(seed: int, scale: Scale, *, quick: bool) -> Study:
    """All parts, in two processes."""
    begun = time.monotonic()
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # read by the processes that are spawned: each has one core
    work = error_curves.pieces(seed, scale)
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        of_paper = [pool.submit(_placement, shape, seed) for shape in scale.objects]
        of_table = [pool.submit(_table, shape, seed, scale.table_draws) for shape in scale.table_objects]
        wrong = pool.submit(_errata, seed)
        of_curves = [pool.submit(error_curves.work, piece) for piece in work]
        _show([*of_paper, *of_table, wrong, *of_curves])
        samples = [sample for part in _results(of_curves) for sample in part]
        placements, table = _results(of_paper), [row for part in _results(of_table) for row in part]
        (errata,) = _results([wrong])
    return Study(
        seed=seed,
        quick=quick,
        scale=scale,
        seconds=time.monotonic() - begun,
        placements=placements,
        errata=errata,
        table=table,
        samples=samples,
        matt=error_curves.curves(samples, glossy=False),
        glossy=error_curves.curves(samples, glossy=True),
    )


def summary(found: Study) -> dict[str, Any]:
    """The figures for programs: errors by method and number of images, the criterion's values, the forecast's truth."""
    told = error_curves.predicted_over_found(found.samples)
    every = [value for values in told.values() for value in values]
    figure = found.placements[-1]
    return {
        "seed": found.seed,
        "quick": found.quick,
        "pixels": found.scale.pixels,
        "objects": list(found.scale.objects),
        "ring_slant_deg": simulated_scene.RING_SLANT_DEG,
        "errors_deg": {curve.method: curve.error_deg for curve in found.matt},
        "half_widths_deg": {curve.method: curve.half_width_deg for curve in found.matt},
        "glossy_errors_deg": {curve.method: curve.error_deg for curve in found.glossy},
        "glossy_half_widths_deg": {curve.method: curve.half_width_deg for curve in found.glossy},
        "errors_by_object_deg": {curve.method: curve.by_object for curve in found.matt},
        "over_10": {curve.method: curve.over_10 for curve in found.matt},
        "straddling": error_curves.straddling(found.samples),
        "errors_of_all_deg": {curve.method: curve.error_of_all_deg for curve in found.matt},
        "glossy_errors_of_all_deg": {curve.method: curve.error_of_all_deg for curve in found.glossy},
        "over_10_of_all": {curve.method: curve.over_10_of_all for curve in found.matt},
        "ratios": ratios(found),
        "phi": {
            "object": figure.object,
            "bound": figure.bound,
            "ours": figure.ours,
            "best_random": figure.best_random,
            "best_heuristic": figure.best_heuristic,
        },
        "phi_by_object": {
            item.object: [item.bound, item.ours, item.best_random, item.best_heuristic] for item in found.placements
        },
        "predicted_over_found": float(np.median(every)),
        "predicted_over_found_by_object": {shape: float(np.median(values)) for shape, values in told.items()},
        "errata": asdict(found.errata),
        "three_images": [asdict(row) for row in found.table],
    }


def ratios(found: Study) -> list[dict[str, Any]]:
    """Ours over each rival at 8, 12 and 20 images, on the same draws."""
    told: list[dict[str, Any]] = []
    for glossy in (False, True):
        for rival in simulated_scene.METHODS[1:]:
            for lights in (8, 12, 20):
                value, half = error_curves.ratio(found.samples, "optimal", rival, lights, glossy=glossy)
                if np.isfinite(value):
                    told.append(
                        {"rival": rival, "lights": lights, "glossy": glossy, "ratio": value, "half_width": half}
                    )
    return told


def _placement(shape: str, seed: int) -> Placement:
    return paper_criterion.placement(
        simulated_scene.Scene(simulated_scene.traced(shape, 1000 * seed, SMALL_PIXELS)), seed
    )


def _table(shape: str, seed: int, draws: int) -> list[Row]:
    return three_images.table(simulated_scene.Scene(simulated_scene.traced(shape, 1000 * seed, SMALL_PIXELS)), draws)


def _errata(seed: int) -> Errata:
    scene = simulated_scene.Scene(simulated_scene.traced("figure", 1000 * seed, SMALL_PIXELS))
    return paper_criterion.errata(paper_criterion.mean_projector(scene), seed)


def _results(futures: Sequence["Future[T]"]) -> list[T]:
    try:
        return [future.result() for future in futures]
    except BrokenProcessPool as error:
        raise RigError(ErrorCode.SERVICE_FAULT, "a process of the study ended: is there memory left?") from error


def _show(futures: Sequence["Future[Any]"]) -> None:
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeElapsedColumn()) as progress:
        task = progress.add_task("study", total=len(futures))
        done: Callable[[Future[Any]], None] = lambda _: progress.advance(task)  # noqa: E731
        for future in futures:
            future.add_done_callback(done)
        for future in futures:
            future.exception()
