"""The end of a failed command: a sentence for a file that its user named, a traceback for a defect of the program."""

import errno
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from api.cli import replaying
from api.cli.commands import app
from api.rest import keys


def failing_at(path: str | int, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Result:
    """Runs `lightpose replay`, or the given command, whose work ends with an error of a file."""

    def fail(*_: object) -> None:
        raise OSError(errno.EACCES, "Permission denied", path)

    monkeypatch.setattr(replaying, "replay", fail)
    monkeypatch.setattr(keys, "read", fail)
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.parametrize(
    "place",
    [
        lambda folder: folder,
        lambda folder: folder / "passes" / "0" / "plan.json",
        lambda folder: folder.parent,
        lambda folder: folder.with_name(".session.k3x"),
        lambda folder: folder.with_suffix(".json"),
    ],
)
def test_error_of_a_named_path_is_a_sentence(
    place: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is named as an argument, or lies below, above or beside it under its name, as partial files do."""
    session = tmp_path / "named" / "session"
    failed = failing_at(str(place(session)), monkeypatch, "replay", str(session))
    assert failed.exit_code == 2
    assert f"request.invalid: {place(session)}: cannot be read or written: Permission denied" in failed.output


@pytest.mark.parametrize("path", ["/usr/share/lightpose/links.json", 3, "NAMED/other/session.json"])
def test_error_of_another_file_keeps_its_traceback(
    path: str | int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = path.replace("NAMED", str(tmp_path)) if isinstance(path, str) else path
    failed = failing_at(where, monkeypatch, "replay", str(tmp_path / "named" / "session"))
    assert isinstance(failed.exception, OSError)
    assert "cannot be read or written" not in failed.output


@pytest.mark.parametrize(
    ("arguments", "variable", "place"),
    [
        (("keys", "list"), "", "data/keys.json"),
        (("keys", "list", "--data=elsewhere"), "", "elsewhere/keys.json"),
        (("keys", "list"), "LIGHTPOSE_DATA", "own/keys.json"),
    ],
)
def test_error_of_a_default_and_of_the_environment_is_a_sentence(
    arguments: tuple[str, ...], variable: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if variable:
        monkeypatch.setenv(variable, str(tmp_path / "own"))
    failed = failing_at(str(tmp_path / place), monkeypatch, *arguments)
    assert failed.exit_code == 2
    assert str(tmp_path / place) in failed.output
