"""The runbook and the example cell agree with the code."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.store import Store

ROOT = Path(__file__).parents[2]
PAGES = ("how-to/new-cell.md", "how-to/operate.md", "how-to/recover-after-a-stop.md", "reference/problems.md")
RUNBOOK = "\n".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in PAGES)
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_runbook_has_a_remedy_for_each_problem_code() -> None:
    table = RUNBOOK.partition("## Problem codes")[2]

    codes = re.findall(r"^\| `([a-z_.]+)` \| [^|]+ \| [^|]+ \|$", table, re.MULTILINE)

    assert sorted(codes) == sorted(ErrorCode)


def test_runbook_example_cell_is_valid() -> None:
    cell = cell_config.load(ROOT / "deploy" / "cell.toml")

    assert cell.camera.kind == "pylon"
    assert cell.obstacles[0].name == "camera stand"


def test_runbook_links_resolve() -> None:
    headings = {line[3:].lower().replace(" ", "-") for line in RUNBOOK.splitlines() if line.startswith("## ")}
    assert set(re.findall(r"\]\(#([a-z-]+)\)", RUNBOOK)) <= headings
    for path in re.findall(r"`((?:acquisition|api|deploy)/[\w./]+)`", RUNBOOK + README):
        assert (ROOT / path).exists(), path


def test_runbook_backup_of_running_service_restores(own: Any, tmp_path: Path) -> None:
    made = own.client.create(Recipe(label="kept"))
    (tmp_path / "backup").mkdir()
    command = re.search(r'-c "(import sqlite3.*)"', RUNBOOK)
    assert command is not None

    database, copy = own.settings.data / "rig.db", tmp_path / "backup" / "rig.db"
    subprocess.run([sys.executable, "-c", command[1], str(database), str(copy)], check=True)
    shutil.copytree(own.settings.data / "sessions", tmp_path / "backup" / "sessions")

    restored = Store(tmp_path / "backup")
    assert restored.journal.session(made.id).recipe.label == "kept"
    assert (restored.folder(made.id) / "recipe.json").exists()
    restored.close()


def test_runbook_metric_names_exist(own: Any) -> None:
    metrics = own.http.get("/metrics").text
    for name in re.findall(r"lightpose_\w+", RUNBOOK):
        if "lateness" not in name:  # reported once an arm has moved
            assert name in metrics


@pytest.mark.parametrize("variable", sorted(set(re.findall(r"LIGHTPOSE_[A-Z_]+", RUNBOOK + README))))
def test_runbook_variables_are_read_by_the_service(variable: str) -> None:
    files = [path for folder in ("api", "tests") for path in (ROOT / folder).rglob("*.py")]
    sources = "".join(path.read_text(encoding="utf-8") for path in files)
    name = variable.removeprefix("LIGHTPOSE_").lower()
    assert f"    {name}: " in sources or variable in sources
