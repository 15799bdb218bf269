"""The tables' arithmetic on lines written by hand, and which solves a run still has to do."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from acquisition.models.result import MEAN_ERROR_PER_SIGMA
from tests.unseen import reports, run, tables


def line(family: str, seed: int, pattern: str, azimuth: int, error: float, lights: int = 8) -> run.Line:
    return {
        "family": family, "seed": seed, "reflectance": None, "fault": None, "solver": "product", "pattern": pattern,
        "lights": lights, "azimuth": azimuth, "within_78_deg.mean": error, "within_1": 0.6, "within_2": 0.95,
        "rms": 1.2, "sigma_mean": error / MEAN_ERROR_PER_SIGMA, "found_mean": error, "within_1.all": 0.5,
        "within_2.all": 0.9, "rms.all": 1.5, "doubtful": 0.0,
    }  # fmt: skip


def test_ratio_has_the_mean_of_azimuths_in_the_denominator() -> None:
    lines = [line("blob", 0, "two-rings", 0, 1.0), line("blob", 0, "two-rings", 1, 3.0)]
    lines += [line("blob", 0, "planned", 0, 1.0), line("blob", 0, "planned", 1, 2.0)]
    assert "0.750" in tables.ratio_table(lines, "within_78_deg")


def test_geometric_mean_over_families_and_its_error() -> None:
    rng = np.random.default_rng(0)
    scatter, scenes = 0.2, 50
    ratios = {(f, s): math.exp(rng.normal(0, scatter)) for f in ("a", "b") for s in range(scenes)}
    center, error = tables.geometric(ratios)
    assert center == pytest.approx(math.exp(np.mean(np.log(list(ratios.values())))))
    assert error == pytest.approx(scatter / math.sqrt(2 * scenes), rel=0.25)
    assert tables.geometric({("a", 0): 4.0, ("a", 1): 1.0, ("b", 0): 1.0})[0] == pytest.approx(math.sqrt(2))


def test_against_pairs_only_what_both_have() -> None:
    new = [line("blob", 0, "planned", 0, 1.0), line("blob", 1, "planned", 0, 9.0)]
    old = [line("blob", 0, "planned", 0, 2.0)]
    assert "0.500" in tables.against_table(new, old, "within_78_deg")


def test_sigma_table_marks_what_is_out_of_bounds() -> None:
    sound, bad = line("blob", 0, "planned", 0, 1.0), line("knot", 0, "planned", 0, 1.0) | {"rms": 3.0}
    rows = tables.sigma_table([sound, bad]).splitlines()
    assert not rows[1].rstrip().endswith("*")
    assert rows[2].rstrip().endswith("*")


def test_forecast_table_has_expected_over_found_errors() -> None:
    planned = line("blob", 0, "planned", 0, 1.0) | {"predicted_sigma": 0.5 / MEAN_ERROR_PER_SIGMA}
    fixed = line("knot", 0, "two-rings", 0, 1.0) | {"predicted_sigma": math.nan}
    rows = tables.forecast_table([planned, fixed]).splitlines()
    assert rows[1].split() == ["blob", "0.500"]
    assert not any("knot" in row for row in rows)


def test_tables_refused_solves_are_listed() -> None:
    failed = {"family": "blob", "seed": 0, "pattern": "planned", "lights": 8, "azimuth": 0, "error": "plan.infeasible"}
    assert "1 refused" in tables.all_tables([failed], "within_78_deg", None)


def test_run_skips_what_is_in_the_file(tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    kept = line("blob", 0, "two-rings", 0, 1.0)
    out.write_text(json.dumps(kept) + "\n", encoding="utf-8")
    plan = run.Plan(("blob",), (0,), (8,), ("two-rings",), 2, out, done=run.done(run.read(out)))
    left = list(plan.of_scene("blob", 0))
    assert [(one["pattern"], one["azimuth"]) for one in left] == [("two-rings", 1)]


def test_run_of_a_report_seed_is_refused_without_report(tmp_path: Path) -> None:
    plan = run.Plan(("blob",), (1000,), (8,), ("two-rings",), 1, tmp_path / "out.jsonl")
    with pytest.raises(ValueError, match="--report"):
        run.run_all(plan, jobs=1)


def test_report_is_appended_with_its_command(tmp_path: Path) -> None:
    path = tmp_path / "reports.md"
    reports.write("run --report", "a table", path)
    reports.write("run --report --lights 8", "another", path)
    text = path.read_text(encoding="utf-8")
    assert text.count("## 20") == 2
    assert text.index("a table") < text.index("another")


def test_fault_table_counts_put_right_named_and_neither() -> None:
    lines = [line("blob", seed, "two-rings", 0, 1.0) for seed in range(3)]
    faulty = [line("blob", seed, "two-rings", 0, error) for seed, error in enumerate((1.2, 4.0, 5.0))]
    findings: list[list[list[object]]] = [[], [["lamps", False]], []]
    lines += [one | {"fault": "gamma", "findings": found} for one, found in zip(faulty, findings, strict=True)]
    row = tables.fault_table(lines, "within_78_deg").splitlines()[1].split()
    assert row == ["gamma", "3", "4.00", "5.00", "1", "1", "1.20", "1.20", "blob", "2"]


def test_alarm_table_counts_uncorrected_findings_and_corrected_faults_by_material() -> None:
    one = line("blob", 0, "two-rings", 0, 1.0) | {"material": "ggx:0.2", "scatter_mm": 0.0}
    lines = [one | {"findings": []}, one | {"findings": [["lamps", False]], "found_mean": 7.0}]
    lines += [one | {"findings": [[kind, True]]} for kind in ("gloss", "bad image")]
    row = tables.alarm_table(lines).splitlines()[1].split()
    assert row == ["ggx", "4", "25.0%", "7.00", "1.00", "25.0%"]


def test_error_table_leaves_out_captures_with_faults() -> None:
    lines = [line("blob", 0, "two-rings", 0, 1.0), line("blob", 0, "two-rings", 0, 9.0) | {"fault": "gamma"}]
    assert "9.00" not in tables.all_tables(lines, "within_78_deg", None).split("fault")[0]
