"""`python -m tests.calibration_seeds run | table`: cells that were never calibrated calibrate themselves, seed by seed.

Each seed is `lightpose demo --calibrate --perturb` in a folder of its own, as a user would run it. A seed takes
minutes, so results are lines of a file, kept as they come: run again, the command goes on with the seeds that are
missing, those that failed among them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

BARS: dict[str, float] = {
    "lamp_mm": 0.5,
    "lamp_direction_deg": 0.1,
    "intensity_percent": 0.5,
    "lobe_percent": 1.0,
    "camera_mm": 0.3,
    "camera_deg": 0.05,
    "focal_percent": 0.1,
    "mean_ratio": 1.1,
    "simulated_seconds": 900.0,
    "computing_processor_seconds": 180.0,
}
"""None of these may be larger. `mean_ratio`: the object's mean error with what was found over that with the true
values."""

NOTED = ("flat_field_percent", "motion_seconds", "stopped_seconds", "computing_seconds", "seconds")
"""Values that stand in the table without a bar."""


def seeds(text: str) -> list[int]:
    """Seeds of `1:21` (the end is not one of them) or `3,5,8`."""
    if ":" in text:
        first, end = (int(part) for part in text.split(":"))
        return list(range(first, end))
    return [int(part) for part in text.split(",")]


def read(file: Path) -> list[dict[str, Any]]:
    """The results so far, the last one of each seed, by seed."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    by_seed = {row["seed"]: row for row in map(json.loads, lines)}
    return [by_seed[seed] for seed in sorted(by_seed)]


def run(wanted: list[int], file: Path) -> None:
    """Runs the seeds that have no result yet, one after another, and appends each as it comes."""
    done = {row["seed"] for row in read(file) if "error" not in row}
    file.parent.mkdir(parents=True, exist_ok=True)
    for seed in wanted:
        if seed in done:
            continue
        row = _demonstrated(seed)
        with file.open("a", encoding="utf-8") as results:
            results.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)


def table(rows: list[dict[str, Any]]) -> str:
    """Medians and worst values over the seeds, in Markdown, and which seeds pass a bar."""
    ended = [_with_ratio(row) for row in rows if "error" not in row]
    lines = [f"{len(ended)} seeds", "", "| | median | worst | bar | seeds above it |", "|---|---|---|---|---|"]
    for name in (*BARS, *NOTED) if ended else ():
        values = sorted(row[name] for row in ended)
        bar = BARS.get(name)
        above = "" if bar is None else ", ".join(str(row["seed"]) for row in ended if row[name] > bar) or "none"
        median = (values[(len(values) - 1) // 2] + values[len(values) // 2]) / 2
        lines.append(f"| `{name}` | {median:.3g} | {values[-1]:.3g} | {'' if bar is None else f'{bar:g}'} | {above} |")
    for name in sorted({key for row in ended for key in row["error_probabilities"]}):
        inside = [row["error_probabilities"][name] <= 0.95 for row in ended if name in row["error_probabilities"]]
        lines.append(f"| {name} in its 95 % ellipsoid | {sum(inside)} of {len(inside)} | | | |")
    lines += ["", *(f"seed {row['seed']} failed: {row['error']}" for row in rows if "error" in row)]
    return "\n".join(lines).rstrip()


def _demonstrated(seed: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "api.cli", "demo", "--calibrate", "--perturb", "--seed", str(seed), "--json"]
    with tempfile.TemporaryDirectory() as folder:
        ended = subprocess.run(
            [*command, "--data", folder], capture_output=True, text=True, check=False, env=dict(os.environ)
        )
    if ended.returncode != 0:
        return {"seed": seed, "error": ended.stderr.strip()[-600:]}
    return json.loads(ended.stdout.strip().splitlines()[-1])


def _with_ratio(row: dict[str, Any]) -> dict[str, Any]:
    return row | {"mean_ratio": row["mean_deg"] / row["mean_deg_true_calibration"]}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.calibration_seeds", description=__doc__)
    parser.add_argument("what", choices=["run", "table"])
    parser.add_argument("--seeds", type=seeds, default=seeds("1:21"), help="as 1:21 or 3,5,8")
    parser.add_argument("--out", type=Path, default=Path("build/calibration_seeds.jsonl"), help="the results' file")
    given = parser.parse_args()
    if given.what == "run":
        run(given.seeds, given.out)
    print(table([row for row in read(given.out) if row["seed"] in given.seeds]))


if __name__ == "__main__":
    main()
