"""The record of model selection, and that recording leaves nothing behind."""

import math
from dataclasses import fields
from pathlib import Path

import pytest

from acquisition.normals.alternatives import model_selection
from acquisition.normals.alternatives.alternative import Alternative
from acquisition.normals.alternatives.term_tests import TermScores
from tests.unseen import patterns, run, scenes, tables, trials
from tests.unseen.captures import capture


@pytest.mark.long
def test_recorded_solve_has_scores_and_trials() -> None:
    scene = scenes.scene("sheet", 0, "oren-nayar:0.5", 40)
    captured = capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1))
    before = model_selection.solve, Alternative.accepted
    with trials.recorded() as record:
        run.solve(scene, captured)
    assert (model_selection.solve, Alternative.accepted) == before
    gain, step = record.scores["roughness"]
    assert gain > 4
    assert step > 0.1
    accepted = [trial for trial in record.trials if trial.accepted]
    assert [trial.kind for trial in accepted] == ["rough surface"]
    assert accepted[0].misfit < 1
    assert accepted[0].loss < 1


def test_selection_tables_show_ranges(tmp_path: Path) -> None:
    trial = {"kind": "ambient light", "step": 0.2, "estimate": 0.1, "misfit": 0.5, "share": 0.4, "accepted": True}
    newer = trial | {"misfit": math.nan, "loss": 0.3}
    lines: list[run.Line] = [
        {"material": "lambert", "scores": {"ambient": (9.0, 0.2), "gloss": (8.0, -0.1)}, "trials": [trial]},
        {"material": "lambert", "scores": {"ambient": (1.0, 0.2), "exponent": (9.0, -0.1)}, "trials": [newer]},
        {"material": "lambert", "fault": "gamma", "scores": {"ambient": (7.0, 0.001)}, "trials": []},
        {"material": "metal", "scores": {field.name: (7.0, -0.5) for field in fields(TermScores)}, "trials": []},
    ]
    rows = [row.split() for row in tables.selection_tables(lines).splitlines() if row]
    assert rows[1] == ["lambert", "ambient", "2", "5.0", "8.2", "9.0", "1"]
    assert rows[-1] == [
        "lambert",
        "ambient",
        "light",
        "accepted",
        "2",
        "0.50–0.50",
        "0.40–0.40",
        "0.30–0.30",
        "0.50–0.50",
    ]
    assert not any(row[0] == "gamma" for row in rows)
    assert [row[1] for row in rows if row[0] == "metal"] == ["excess", "exponent", "turn"]
