"""Runs the parts of the study in two processes, and collects their results for the page and for programs.

The number of draws is fixed and never limited by time, so that a seed gives the same figures on every machine.
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

from acquisition.formats.session_files import refuse_in_session
from acquisition.models.errors import ErrorCode, RigError
from api.cli.study import error_curves, page, paper_criterion, scene_geometry, simulated_scene, three_images
from api.cli.study.error_curves import Draws, Scale
from api.cli.study.paper_criterion import Errata, Placement
from api.cli.study.study_result import StudyResult
from api.cli.study.three_images import Row

PROCESSES = 2
SMALL_PIXELS = 128

T = TypeVar("T")


FULL = Scale(
    pixels=scene_geometry.PIXELS,
    objects=simulated_scene.OBJECTS,
    glossy_objects=simulated_scene.OBJECTS,
    diffuse=Draws(
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
    diffuse=Draws(rivals={3: 1, 8: 1, 12: 1}, compared={8: 1}, others={8: 1}),
    glossy=Draws(rivals={8: 1}, compared={8: 1}, others={8: 1}),
    table_objects=("figure", "vase"),
    table_draws=2,
)


def run(seed: int, out: Path, *, quick: bool) -> dict[str, Any]:
    """Runs the study, writes `study.html` and `study.json` into `out`, and returns the content of the latter.

    Raises RigError service.fault when a process of the study dies, and folder.invalid for a session's folder.
    """
    refuse_in_session(out, "--out")
    out.mkdir(parents=True, exist_ok=True)
    result = measure(seed, QUICK if quick else FULL, quick=quick)
    figures = summary(result)
    page.write(out / "study.html", result, figures)
    page.write_json(out / "study.json", {**figures, "samples": [asdict(sample) for sample in result.samples]})
    return figures


def measure(seed: int, scale: Scale, *, quick: bool) -> StudyResult:
    """Measures all parts, in two processes."""
    started = time.monotonic()
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # read by the spawned processes, each of which has one core
    work = error_curves.work_items(seed, scale)
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        of_paper = [pool.submit(_placement, shape, seed) for shape in scale.objects]
        of_table = [pool.submit(_table, shape, seed, scale.table_draws) for shape in scale.table_objects]
        of_errata = pool.submit(_errata, seed)
        of_curves = [pool.submit(error_curves.run_item, item) for item in work]
        _show([*of_paper, *of_table, of_errata, *of_curves])
        samples = [sample for part in _results(of_curves) for sample in part]
        placements, table = _results(of_paper), [row for part in _results(of_table) for row in part]
        (errata,) = _results([of_errata])
    return StudyResult(
        seed=seed,
        quick=quick,
        scale=scale,
        seconds=time.monotonic() - started,
        placements=placements,
        errata=errata,
        table=table,
        samples=samples,
        diffuse=error_curves.curves(samples, glossy=False),
        glossy=error_curves.curves(samples, glossy=True),
    )


def summary(result: StudyResult) -> dict[str, Any]:
    """Returns the figures for programs: errors by method and number of images, criterion, predicted over observed."""
    predictions = error_curves.predicted_over_observed(result.samples)
    every = [value for values in predictions.values() for value in values]
    figure = result.placements[-1]
    return {
        "seed": result.seed,
        "quick": result.quick,
        "pixels": result.scale.pixels,
        "objects": list(result.scale.objects),
        "ring_slant_deg": simulated_scene.RING_SLANT_DEG,
        "errors_deg": {curve.method: curve.error_deg for curve in result.diffuse},
        "half_widths_deg": {curve.method: curve.half_width_deg for curve in result.diffuse},
        "glossy_errors_deg": {curve.method: curve.error_deg for curve in result.glossy},
        "glossy_half_widths_deg": {curve.method: curve.half_width_deg for curve in result.glossy},
        "errors_by_object_deg": {curve.method: curve.by_object for curve in result.diffuse},
        "over_10": {curve.method: curve.over_10 for curve in result.diffuse},
        "straddling": error_curves.mixed_share(result.samples),
        "errors_of_all_deg": {curve.method: curve.error_of_all_deg for curve in result.diffuse},
        "glossy_errors_of_all_deg": {curve.method: curve.error_of_all_deg for curve in result.glossy},
        "over_10_of_all": {curve.method: curve.over_10_of_all for curve in result.diffuse},
        "ratios": ratios(result),
        "phi": {
            "object": figure.object,
            "bound": figure.bound,
            "ours": figure.ours,
            "best_random": figure.best_random,
            "best_heuristic": figure.best_heuristic,
        },
        "phi_by_object": {
            item.object: [item.bound, item.ours, item.best_random, item.best_heuristic] for item in result.placements
        },
        "predicted_over_found": float(np.median(every)),
        "predicted_over_found_by_object": {shape: float(np.median(values)) for shape, values in predictions.items()},
        "errata": asdict(result.errata),
        "three_images": [asdict(row) for row in result.table],
    }


def ratios(result: StudyResult) -> list[dict[str, Any]]:
    """Returns our error over each rival's at 8, 12 and 20 images, on the same draws."""
    rows: list[dict[str, Any]] = []
    for glossy in (False, True):
        for rival in simulated_scene.METHODS[1:]:
            for lights in (8, 12, 20):
                value, half = error_curves.ratio(result.samples, "optimal", rival, lights, glossy=glossy)
                if np.isfinite(value):
                    rows.append(
                        {"rival": rival, "lights": lights, "glossy": glossy, "ratio": value, "half_width": half}
                    )
    return rows


def _placement(shape: str, seed: int) -> Placement:
    return paper_criterion.placement(
        simulated_scene.Scene(scene_geometry.cached_geometry(shape, 1000 * seed, SMALL_PIXELS)), seed
    )


def _table(shape: str, seed: int, draws: int) -> list[Row]:
    return three_images.table(
        simulated_scene.Scene(scene_geometry.cached_geometry(shape, 1000 * seed, SMALL_PIXELS)), draws
    )


def _errata(seed: int) -> Errata:
    scene = simulated_scene.Scene(scene_geometry.cached_geometry("figure", 1000 * seed, SMALL_PIXELS))
    return paper_criterion.errata(paper_criterion.mean_projector(scene), seed)


def _results(futures: Sequence["Future[T]"]) -> list[T]:
    try:
        return [future.result() for future in futures]
    except BrokenProcessPool as error:
        raise RigError(
            ErrorCode.SERVICE_FAULT, "a process of the study ended unexpectedly: check that enough memory is free"
        ) from error


def _show(futures: Sequence["Future[Any]"]) -> None:
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeElapsedColumn()) as progress:
        task = progress.add_task("study", total=len(futures))
        done: Callable[[Future[Any]], None] = lambda _: progress.advance(task)  # noqa: E731
        for future in futures:
            future.add_done_callback(done)
        for future in futures:
            future.exception()
