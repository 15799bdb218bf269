"""`lightpose demo` of objects that are not built in: a mesh file with each reflectance, and random families."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

ROOT = Path(__file__).parents[2]

MESH_LIMITS_DEG = {"lambert": 0.65, "oren-nayar:0.35": 0.7, "ggx:0.2": 0.65, "metal:0.3": 2.5}
"""Mean error within 78° that a wavy ball may have with 8 lights, about 1.5 times what was found (0.42, 0.45, 0.42,
1.66°, November 2026): they notice a broken rendering, and a solver that lost its model of roughness, gloss or metal."""

METHODS = {"metal:0.3": "two-rings"}
"""A metal's images give a wrong depth, on which the service refuses to plan near the keep-out: so it is not planned."""


def demo(folder: Path, *arguments: str) -> dict[str, Any]:
    done = subprocess.run(
        [
            sys.executable, "-m", "api.cli", "demo", *arguments, "--pixels", "160", "--speed", "8", "--no-random",
            "--data", str(folder), "--json",
        ],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=1200,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def wavy_ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    body = trimesh.creation.icosphere(6, 1.0)
    x, y, z = body.vertices.T
    radius = 1 + 0.08 * np.sin(4 * x + 1) * np.cos(3 * y) + 0.06 * np.sin(5 * z + 2 * x)
    body.vertices = body.vertices * radius[:, None] * [1.1, 0.9, 0.7]
    path = tmp_path_factory.mktemp("mesh") / "wavy ball.stl"
    body.export(path)
    return path


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("reflectance", MESH_LIMITS_DEG)
def test_demo_mesh_is_graded_against_its_truth(tmp_path: Path, wavy_ball: Path, reflectance: str) -> None:
    method = METHODS.get(reflectance, "optimal")
    mesh = ("--mesh", str(wavy_ball), "--size-mm", "90")
    outcome = demo(tmp_path, *mesh, "--reflectance", reflectance, "--method", method)
    assert outcome["object"] == f"wavy ball.stl ({reflectance})"
    gradings = outcome["gradings"]
    assert set(gradings) == {"one_surface", "within_78_deg", "object"}
    assert gradings["one_surface"]["graded_pixels"] <= gradings["within_78_deg"]["graded_pixels"]
    assert gradings["within_78_deg"]["graded_pixels"] < gradings["object"]["graded_pixels"]
    assert outcome["mean_deg"] < MESH_LIMITS_DEG[reflectance]
    assert outcome["coverage"] > 0.9


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("family", "seed"), [("blob", 0), ("turned", 0), ("relief", 5)])
def test_demo_family_is_graded_against_its_truth(tmp_path: Path, family: str, seed: int) -> None:
    outcome = demo(tmp_path, "--family", family, "--seed", str(seed))
    assert outcome["object"] == f"family {family}"
    assert outcome["seed"] == seed
    assert outcome["mean_deg"] < 6.0
