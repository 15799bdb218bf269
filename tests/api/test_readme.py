"""The README's session runs unchanged, except for the address, against a fast service."""

import json
import re
import subprocess
import sys
from pathlib import Path

from acquisition.session_state import State
from api.rest.schemas import OwnLights
from tests.model.quick_rig import quick_service

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
REST = (ROOT / "docs" / "reference" / "rest.md").read_text(encoding="utf-8")
SESSION = README.partition("## A session")[2].partition("\n## ")[0]


def block(language: str, holding: str) -> str:
    """The first block in a language that holds these words."""
    blocks = [text for text in re.findall(rf"```{language}\n(.*?)```", SESSION, re.DOTALL) if holding in text]
    return blocks[0]


def test_readme_session_in_python_and_shell_runs(tmp_path: Path) -> None:
    script, commands = block("python", "client.capture"), block("sh", "curl")
    assert len(script.splitlines()) <= 15
    with quick_service(tmp_path, "127.0.15.32", with_keys=False) as (server, _, url, _secrets):
        python = subprocess.run(
            [sys.executable, "-c", script.replace("http://127.0.0.1:8000", url)],
            cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False, env={"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert python.returncode == 0, python.stderr
        assert "mean σ of the normals: 1.00°" in python.stdout
        assert (tmp_path / "normals.png").read_bytes() == b"normals"
        (tmp_path / "normals.png").unlink()

        host = url.removeprefix("http://")
        # The shell's listener ends by itself after a minute; here the session has long ended by then.
        shell = commands.replace("localhost:8000", host).replace("--max-time 60", "--max-time 3")
        completed = subprocess.run(
            ["bash", "-c", shell], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
        )
        events = [json.loads(line[6:]) for line in completed.stdout.splitlines() if line.startswith("data: ")]
        assert events[-1]["body"]["state"] == State.COMPLETED
        assert (tmp_path / "normals.png").read_bytes() == b"normals"
        states = [row.state for row in server.service.store.journal.sessions(10)]
    assert states == [State.COMPLETED] * 2


def test_readme_own_lights_body_is_valid() -> None:
    (body,) = re.findall(r"passes/1/plan .* -d '(.*)'", REST)
    assert len(OwnLights.model_validate_json(body).lights) == 2
