"""Compares sessions with planned exposures with those of one automatic exposure per light, over objects and seeds.

    python -m tests.exposures --finishes contrast --shapes vase,bumps --seeds 0-2 --out /tmp/contrast.jsonl

Each draw is one line of JSON. Two ratios are printed, geometric means over the draws with their standard errors: the
error of planned over automatic exposures at equal capture time (sessions with automatic exposures of several numbers
of lights are interpolated), and the time of planned over automatic exposures at equal mean σ. Design seeds are 0–9,
report seeds from 10.
"""

import argparse
import json
import time
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.models.recipe import Exposure
from tests.exposures.bench import FINISHES, Outcome, Sessions, at_time, scene, time_for

CALIBRATION = ("error_deg", "dark_error_deg", "sigma_deg", "within_sigma", "rms_over_sigma")
"""Figures of sessions of eight images whose means are printed."""

PLANNED = 4
FIXED = (2, 4, 8)
"""Planned lights of the sessions with planned exposures, and of those with automatic ones, beside the pilot's four."""


def main() -> None:
    """Runs the draws that the output has not yet, and prints the ratios of all."""
    parser = argparse.ArgumentParser(prog="python -m tests.exposures", description=__doc__.split("\n", 1)[0])
    parser.add_argument("--shapes", default="vase,bumps,figure,part")
    parser.add_argument("--finishes", default="contrast", help=f"of {', '.join(FINISHES)}")
    parser.add_argument("--seeds", default="0-2", help="first-last")
    parser.add_argument("--pixels", type=int, default=128)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--gloss", type=float, default=None, help="instead of the finish's own")
    parser.add_argument("--exposure", default="{}", help="further fields of the recipe's exposure, JSON")
    asked = parser.parse_args()
    first, _, last = asked.seeds.partition("-")
    lines = _read(asked.out)
    done = {(line["shape"], line["finish"], line["seed"]) for line in lines}
    wanted = Exposure(plan="planned", **json.loads(asked.exposure))
    for seed in range(int(first), int(last or first) + 1):
        for shape in asked.shapes.split(","):
            for finish in asked.finishes.split(","):
                if (shape, finish, seed) in done:
                    continue
                begun = time.monotonic()
                sessions = Sessions(scene(shape, finish, seed, asked.pixels, asked.gloss), seed)
                line = {
                    "shape": shape, "finish": finish, "seed": seed,
                    "planned": asdict(sessions.run(wanted, PLANNED)),
                    "fixed": [asdict(sessions.run(Exposure(), count)) for count in FIXED],
                    "wall_s": round(time.monotonic() - begun, 1),
                }  # fmt: skip
                lines.append(line)
                with asked.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
                print(_said(line), flush=True)
    print(table(lines))


def table(lines: list[dict[str, Any]]) -> str:
    """Ratios by finish, and the calibration of σ of both kinds of sessions of eight images."""
    by_finish: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        by_finish[line["finish"]].append(line)
    out: list[str] = []
    for finish, some in by_finish.items():
        figures = [_figures(line) for line in some]
        out.append(f"{finish}: {len(some)} draws")
        for name in figures[0]:
            logs = np.log([one[name] for one in figures])
            mean, deviation = float(np.mean(logs)), float(np.std(logs, ddof=1)) if len(logs) > 1 else float("nan")
            out.append(f"  {name}, planned over automatic: {np.exp(mean):.3f} ± {deviation / len(logs) ** 0.5:.3f}")
        for kind in ("planned", "fixed"):
            eight = [line["planned"] if kind == "planned" else _eight(line) for line in some]
            means = {name: np.nanmean([one[name] for one in eight]) for name in CALIBRATION}
            out.append("  " + kind + ": " + ", ".join(f"{name} {value:.3f}" for name, value in means.items()))
    return "\n".join(out)


def _eight(line: dict[str, Any]) -> dict[str, Any]:
    return next(one for one in line["fixed"] if one["lights"] == line["planned"]["lights"])


def _figures(line: dict[str, Any]) -> dict[str, float]:
    planned, fixed = Outcome(**line["planned"]), [Outcome(**one) for one in line["fixed"]]
    eight = Outcome(**_eight(line))
    return {
        "error at equal time": planned.error_deg / at_time(fixed, planned.seconds, "error_deg"),
        "time at equal σ": planned.seconds / time_for(fixed, planned.sigma_deg, "sigma_deg"),
        "time at equal error": planned.seconds / time_for(fixed, planned.error_deg, "error_deg"),
        "error, 8 images": planned.error_deg / eight.error_deg,
        "time, 8 images": planned.seconds / eight.seconds,
    }


def _said(line: dict[str, Any]) -> str:
    figures = ", ".join(f"{name} {value:.2f}" for name, value in _figures(line).items())
    return f"{line['shape']}-{line['finish']} {line['seed']}: {figures} ({line['wall_s']} s)"


def _read(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


if __name__ == "__main__":
    main()
