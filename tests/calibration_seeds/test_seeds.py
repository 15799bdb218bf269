"""The table of seeds: which pass, which do not, which have to be run again."""

import json
from pathlib import Path
from typing import Any

from tests.calibration_seeds.__main__ import BARS, NOTED, read, seeds, table

GOOD = {name: 0.5 * bar for name, bar in BARS.items()} | dict.fromkeys(NOTED, 1.0)


def row(seed: int, **changed: float) -> dict[str, Any]:
    means = {"mean_deg": 0.4, "mean_deg_true_calibration": 0.4, "error_probabilities": {"lamp": 0.3 * seed}}
    return GOOD | means | {"seed": seed} | changed


def test_table_names_seeds_above_their_bars(tmp_path: Path) -> None:
    file = tmp_path / "seeds.jsonl"
    rows = [
        row(1),
        {"seed": 2, "error": "no board"},
        row(3, lamp_mm=0.7),
        row(2, mean_deg=0.5),
        {"seed": 4, "error": "x"},
    ]
    file.write_text("".join(json.dumps(one) + "\n" for one in rows), encoding="utf-8")
    said = table(read(file))
    assert said.startswith("3 seeds\n")
    assert "| `lamp_mm` | 0.25 | 0.7 | 0.5 | 3 |" in said
    assert "| `mean_ratio` | 1 | 1.25 | 1.1 | 2 |" in said
    assert "| lamp in its 95 % ellipsoid | 3 of 3 |" in said
    assert said.endswith("seed 4 failed: x")


def test_seeds_are_read_as_ranges_and_lists() -> None:
    assert seeds("1:4") == [1, 2, 3]
    assert seeds("7,9") == [7, 9]
