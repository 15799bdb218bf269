"""The replay of a dome: its lamps, its random choices, its table, and one small dome through the command line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.unseen import dome, scenes
from tests.unseen.run import Line, done, read


def line(kind: str, choice: int, error: float, seed: int = 0, family: str = "blob") -> Line:
    values = (family, seed, None, 144, 8, kind, choice)
    return dict(zip(dome.IDENTITY, values, strict=True)) | {"within_78_deg.mean": error}


def replay(out: Path, seed: int = 0, choices: int = 1) -> dome.Replay:
    known = done(read(out), dome.IDENTITY)
    return dome.Replay(("sheet",), (seed,), 8, dome.KINDS, choices, out, pixels=144, done=known)


def test_lamps_are_on_the_dome_between_the_slants() -> None:
    scene = scenes.scene("sheet", 0)
    offsets = dome.lamps(scene) - scene.center
    assert offsets.shape == (96, 3)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), scene.radius_m)
    slant_deg = np.degrees(np.arccos(offsets[:, 2] / scene.radius_m))
    assert slant_deg.min() == pytest.approx(10)
    assert slant_deg.max() == pytest.approx(70)
    first = dome.pilot_numbers(scene)
    assert len(set(first)) == 4
    assert slant_deg[first].min() < 30


@pytest.mark.parametrize("kind", dome.KINDS)
def test_random_choice_is_distinct_and_repeatable(kind: str) -> None:
    first = [3, 50, 64, 90]
    chosen = [dome.random_choice(line(kind, k, 1.0), first, 8) for k in range(30)]
    assert chosen == [dome.random_choice(line(kind, k, 1.0), first, 8) for k in range(30)]
    assert all(len(set(numbers)) == 8 and set(numbers) <= set(range(96)) for numbers in chosen)
    assert all(numbers[:4] == first for numbers in chosen) is (kind == "pilot")
    assert len({tuple(sorted(numbers)) for numbers in chosen}) == 30


def test_table_counts_choices_with_smaller_errors() -> None:
    lines = [line("plan", 0, 1.0), line("pilot alone", 0, 3.0)]
    lines += [line("any", k, error) for k, error in enumerate((0.5, 1.5, 2.0, 2.5))]
    lines += [line("plan", 0, 1.0, family="knot"), line("any", 0, 2.0, family="knot")]
    text = dome.table(lines, "within_78_deg")
    assert "better  25.0%" in text
    assert "mean over families: 12.5%" in text


def test_replay_leaves_out_what_the_file_holds(tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    dome.append(out, line("any", 0, 1.0, family="sheet"))
    left = [(one["kind"], one["choice"]) for one in replay(out, choices=2).of_scene("sheet", 0)]
    assert left == [("plan", 0), ("pilot alone", 0), ("pilot", 0), ("any", 1), ("pilot", 1)]


def test_replay_of_a_report_seed_is_refused_without_report(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--report"):
        dome.run_all(replay(tmp_path / "out.jsonl", seed=1000), jobs=1)


@pytest.mark.long
def test_replay_plan_beats_the_pilot_alone(tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    run = replace(replay(out, seed=3), pixels=72)
    assert dome.run_all(run, jobs=1) == 4
    by_kind = {str(one["kind"]): one for one in read(out)}
    assert by_kind["plan"]["lamps"][:4] == by_kind["pilot alone"]["lamps"]  # type: ignore[index]
    assert by_kind["plan"]["within_78_deg.mean"] < 0.8 * by_kind["pilot alone"]["within_78_deg.mean"]  # type: ignore[operator]
    assert dome.run_all(replace(run, done=done(read(out), dome.IDENTITY)), jobs=1) == 0
