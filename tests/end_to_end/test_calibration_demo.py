"""A cell that was never calibrated calibrates itself, as `lightpose demo --calibrate --perturb` shows it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.long
def test_demo_calibrate_finds_what_was_perturbed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "api.cli", "demo", "--calibrate", "--perturb", "--seed", "1", "--json"]
    ended = subprocess.run(
        [*command, "--data", str(tmp_path)], capture_output=True, text=True, check=False, env=dict(os.environ)
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    found = json.loads(ended.stdout.strip().splitlines()[-1])
    assert found["lamp_mm"] <= 0.5
    assert found["lamp_direction_deg"] <= 0.1
    assert found["intensity_percent"] <= 0.5
    assert found["lobe_percent"] <= 1
    assert found["camera_mm"] <= 0.3
    assert found["camera_deg"] <= 0.05
    assert found["focal_percent"] <= 0.1
    assert found["mean_deg"] <= 1.1 * found["mean_deg_true_calibration"]
