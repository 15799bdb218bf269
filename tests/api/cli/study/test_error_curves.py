"""Intervals, ratios and curves from samples of known errors, and the page made of them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from api.cli.study import error_curves, page, paper_criterion, run, three_images
from api.cli.study.error_curves import Draws, Sample
from api.cli.study.study_result import StudyResult

WHO = Sample("sphere", 0, False, "optimal", 8, 0.6, 0.5, 0.0, 0.05, 0.9, 0.02, 0.7, 0.65)


def drawn(method: str, level: float, noise: float = 0.0, draws: int = 6, lights: int = 8) -> list[Sample]:
    rng = np.random.default_rng(5)  # the same draws for all methods
    return [
        replace(WHO, shape=shape, draw=draw, method=method, lights=lights,
                mean_deg=level * (1 + number + noise * rng.normal()))
        for number, shape in enumerate(error_curves.OBJECTS)
        for draw in range(draws)
    ]  # fmt: skip


def test_half_width_equal_draws_of_unlike_objects_is_zero() -> None:
    same = [np.array([value, value]) for value in (1.0, 5.0, 9.0)]
    assert error_curves.half_width(same) == 0
    assert error_curves.half_width([np.array([1.0])]) == 0
    values = np.random.default_rng(1).normal(size=12)
    assert error_curves.half_width([values]) == pytest.approx(
        stats.t.ppf(0.975, 11) * np.std(values, ddof=1) / np.sqrt(12)
    )


def test_ratio_paired_draws_has_narrower_interval_than_errors() -> None:
    samples = drawn("optimal", 0.9, noise=0.5) + drawn("two-rings", 1.0, noise=0.5) + drawn("ring", 2.0, draws=2)
    value, half = error_curves.ratio(samples, "optimal", "two-rings", 8, glossy=False)
    assert value == pytest.approx(0.9)
    assert half < 1e-9
    (curve,) = [item for item in error_curves.curves(samples, glossy=False) if item.method == "optimal"]
    assert curve.half_width_deg[8] > 0.01
    assert error_curves.ratio(samples, "optimal", "ring", 8, glossy=False)[0] < 0.9
    assert np.isnan(error_curves.ratio(samples, "optimal", "paper", 8, glossy=False)[0])


def test_work_items_full_study_has_each_draw_once() -> None:
    items = error_curves.work_items(2, run.FULL)
    assert len({(item.shape, item.draw) for item in items}) == len(items)
    assert all(item.diffuse is not None and item.glossy is not None for item in items)
    assert all(run.FULL.diffuse.rivals[lights] >= 6 for lights in (8, 12, 20))
    assert all(min(run.FULL.diffuse.of(method)) == 3 and max(run.FULL.diffuse.of(method)) == 24 for method in
               ("optimal", "random"))  # fmt: skip


def test_page_of_known_samples_is_offline_and_holds_figures(tmp_path: Path) -> None:
    weight = np.diag([0.6, 0.6, 0.8])
    placement = paper_criterion.Placement(
        "sphere", 1.9, 1.9, 1.95, 1.91, 58.0, 2.0, [(20.0, 3.0), (58.0, 1.91), (85.0, 9.0)], [2.0] * 9, 1000
    )
    samples = [item for lights in (8, 12) for name, level in (("optimal", 0.9), ("two-rings", 1.0), ("random", 1.7))
               for item in drawn(name, level, 0.1, lights=lights)]  # fmt: skip
    samples += [replace(item, glossy=True) for item in samples]
    rows = [three_images.Row(item.name, "sphere", 2.0, 0.6, 1.0) for item in three_images.conditions(1)]
    scale = replace(run.QUICK, objects=("sphere",), diffuse=Draws({8: 6}, {8: 6}, {8: 6}))
    result = StudyResult(
        seed=1, quick=True, scale=scale, seconds=1.0, placements=[placement],
        errata=paper_criterion.errata(weight, 1, triples=100), table=rows, samples=samples,
        diffuse=error_curves.curves(samples, glossy=False), glossy=error_curves.curves(samples, glossy=True),
    )  # fmt: skip
    summary = run.summary(result)
    page.write(tmp_path / "study.html", result, summary)
    text = (tmp_path / "study.html").read_text(encoding="utf-8")

    assert not re.search(r"(src|href)=|url\(|@import|<script|https?://", text)
    assert text.count("<svg") == text.count("</svg>") == 3
    assert "0.900" in text
    assert json.loads(json.dumps(summary, allow_nan=False))["errors_deg"]["optimal"]["8"] > 0
    assert summary["phi"]["bound"] == 1.9
    assert summary["straddling"] == dict.fromkeys(error_curves.OBJECTS, pytest.approx(0.05))
    assert summary["over_10"]["optimal"][8] == 0
    assert summary["over_10_of_all"]["optimal"][8] == pytest.approx(0.02)
    assert "5.00 %" in text
    assert "2.000 %" in text
    assert set(summary["ratios"][0]) == {"rival", "lights", "glossy", "ratio", "half_width"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.html"]
