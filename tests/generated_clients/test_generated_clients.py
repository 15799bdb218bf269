"""Clients generated from the description run a whole session: events, a region upload, bytes, a refusal."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from api import Client
from hardware_sim.cell import Cell, CellOptions
from tests.end_to_end.processes import Service, serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "how-to" / "generated-clients.md"
PIXELS = 96


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Generator[Service]:
    folder = tmp_path_factory.mktemp("cell")
    cell_file = ROOT / "tests" / "data" / "cell.test.toml"
    options = CellOptions("127.0.46.1", "sphere", 1, "ideal", 8.0, pixels=PIXELS, cell_file=cell_file)
    with Cell(options, folder / "cell") as cell, serving(cell, folder / "data") as running:
        with Client(running.url) as client:
            client.wait_ready(120)
        yield running


@pytest.fixture
def mask(tmp_path: Path) -> Path:
    """A region of interest: the middle of the image, a quarter of its pixels."""
    drawn = np.zeros((PIXELS, PIXELS), np.uint8)
    drawn[PIXELS // 4 : -PIXELS // 4, PIXELS // 4 : -PIXELS // 4] = 255
    path = tmp_path / "mask.png"
    path.write_bytes(cv2.imencode(".png", drawn)[1].tobytes())
    return path


def run(*command: str | Path, cwd: Path, env: dict[str, str] | None = None) -> str:
    """What a command prints; AssertionError with its complaint when it fails, or warns of anything."""
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert "WARNING parsing" not in said, said
    assert "Warning(s)" not in said, said
    return done.stdout


def judge(seen: dict[str, Any], folder: Path) -> None:
    """What a session by any client must have seen and downloaded."""
    ids = seen["event_ids"]
    assert ids == sorted(set(ids))
    assert {"session.created", "region.drawn", "shot.captured", "normals.ready"} <= set(seen["event_types"])
    assert seen["state"] == "completed"
    assert (seen["may_start"], seen["same"], seen["region_pixels"]) == (True, True, PIXELS**2 // 4)
    assert 0 < seen["sigma_deg"] < 5
    assert seen["missing"] == "session.not_found"
    for name in ("normals.png", "image.png"):
        picture = cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        assert picture.shape[:2] == (PIXELS, PIXELS)


def test_generated_python_client_runs_a_whole_session(service: Service, mask: Path, tmp_path: Path) -> None:
    stated = re.search(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert stated is not None
    (tmp_path / "settings.yml").write_text(stated[1], encoding="utf-8")
    run(sys.executable, "-m", "venv", tmp_path / "venv", cwd=tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--requirement", HERE / "requirements.txt", cwd=tmp_path)
    run(
        python, "-m", "openapi_python_client", "generate", "--path", ROOT / "api" / "openapi.json", "--meta", "none",
        "--config", "settings.yml", "--output-path", "lightpose_client", "--fail-on-warning", cwd=tmp_path,
        env={"PATH": f"{python.parent}:/usr/bin:/bin"},
    )  # fmt: skip
    said = run(
        python, HERE / "python_session.py", service.url, mask, tmp_path, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}
    )
    judge(json.loads(said), tmp_path)


def test_generated_typescript_client_runs_a_whole_session(service: Service, mask: Path, tmp_path: Path) -> None:
    if shutil.which("npm") is None:
        pytest.skip("needs Node: apt-get install nodejs npm")
    for name in ("package.json", "package-lock.json", "tsconfig.json", "session.ts"):
        shutil.copy(HERE / "typescript" / name, tmp_path)
    run("npm", "ci", "--silent", "--ignore-scripts", "--no-audit", "--no-fund", cwd=tmp_path)
    run("npx", "openapi-typescript", ROOT / "api" / "openapi.json", "--output", "lightpose.d.ts", cwd=tmp_path)
    run("npx", "tsc", cwd=tmp_path)
    said = run("node", "built/session.js", service.url, mask, tmp_path, cwd=tmp_path)
    judge(json.loads(said), tmp_path)
