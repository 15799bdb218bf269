"""Commands that load kernels are refused where no folder can store compiled ones."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

import acquisition
from api.cli.commands import app


@pytest.fixture
def nothing_writable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folders that numba tries are files, which even root cannot write into; returns the place of another one."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    package = tmp_path / "package"
    package.mkdir()
    for file in (package / "__pycache__", package / "__init__.py", tmp_path / "caches"):
        file.touch()
    monkeypatch.setattr(acquisition, "__file__", str(package / "__init__.py"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    return tmp_path / "kernels"


@pytest.mark.parametrize("command", ["serve --cell cell.toml", "solve folder", "calibrate board --out board.pdf"])
def test_command_without_a_folder_for_kernels_exits_2(command: str, nothing_writable: Path) -> None:
    refused = CliRunner().invoke(app, command.split())
    assert refused.exit_code == 2
    assert refused.output.startswith("config.invalid: compiled kernels cannot be stored in ")
    assert "NUMBA_CACHE_DIR" in refused.output


def test_help_and_keys_need_no_folder_for_kernels(nothing_writable: Path) -> None:
    assert CliRunner().invoke(app, ["solve", "--help"]).exit_code == 0
    assert CliRunner().invoke(app, ["keys", "list", "--data", str(nothing_writable)]).exit_code == 0


def test_folder_of_the_environment_is_enough(nothing_writable: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(nothing_writable))
    refused = CliRunner().invoke(app, ["solve", str(nothing_writable / "nowhere")])
    assert "compiled kernels" not in refused.output
