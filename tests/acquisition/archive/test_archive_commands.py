"""`lightpose archive …` as a user calls it: push, list, show, verify, solve, export; bad input in a sentence."""

import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import Catalogue, in_folder, meta
from acquisition.models.recipe import Recipe
from acquisition.store.journal import Journal
from api.cli.commands import app
from tests.acquisition.archive import session_copies

MakeSession = Callable[..., Path]


def call(*arguments: object, status: int = 0) -> str:
    """Runs `lightpose archive …` and returns its output; what people read is on the error stream."""
    result = CliRunner().invoke(app, ["archive", *map(str, arguments)])
    assert result.exit_code == status, result.output
    return result.output


def figures(*arguments: object, status: int = 0) -> dict[str, Any]:
    return json.loads(call(*arguments, "--json", status=status).splitlines()[-1])


@pytest.fixture
def filled(tmp_path: Path, session_folder: MakeSession) -> Path:
    """An archive of two sessions."""
    one = session_folder("20261121-190041-aaaaaa", 1)
    two = session_folder("20261121-190041-bbbbbb", 2, label="amphora")
    address = tmp_path / "objects"
    assert figures("create", address)["new"]
    assert figures("push", address, one, two)["new"] == 2
    return address


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    """A new archive."""
    Archive.create(str(tmp_path / "objects")).close()
    return tmp_path / "objects"


def test_create_keeps_an_archive_that_is_there(filled: Path):
    assert not figures("create", filled)["new"]
    assert len(figures("list", filled)["sessions"]) == 2


@pytest.mark.parametrize("name", ["mistyped", "mount_point"])
def test_push_begins_no_archive(tmp_path: Path, session_folder: MakeSession, name: str):
    (tmp_path / "mount_point").mkdir()
    said = " ".join(call("push", tmp_path / name, session_folder(), status=2).split())
    assert "archive.address_invalid" in said
    assert "`lightpose archive create`" in said
    assert not list((tmp_path / "mount_point").iterdir())
    assert not (tmp_path / "mistyped").exists()


def test_push_data_folder_takes_its_completed_sessions(tmp_path: Path, empty: Path, session_folder: MakeSession):
    (tmp_path / "rig.db").touch()
    session_folder("sessions/20261121-190041-aaaaaa")
    (tmp_path / "sessions" / "20261121-190041-running").mkdir()
    assert figures("push", empty, tmp_path)["new"] == 1


@pytest.mark.parametrize("given", ["data", "data/sessions/{}"])
def test_push_takes_the_label_that_a_person_has_corrected(
    tmp_path: Path, empty: Path, monkeypatch: pytest.MonkeyPatch, given: str
):
    (tmp_path / "data").mkdir()
    journal = Journal(tmp_path / "data" / "rig.db")
    session_id = journal.create_session(Recipe(label="vase"), "{}", "fingerprint")[0].id
    journal.describe_session(session_id, "amphora", "red", "a person")
    journal.close()
    session_copies.make(tmp_path / "data" / "sessions" / session_id, label="vase")
    monkeypatch.chdir(tmp_path)
    assert figures("push", empty, given.format(session_id))["new"] == 1
    (session,) = figures("list", empty)["sessions"]
    assert (session["object"], session["notes"]) == ("amphora", "red")


def test_push_of_a_folder_that_is_no_session_says_what_it_lacks(tmp_path: Path, empty: Path):
    assert "there is no such folder" in call("push", empty, tmp_path / "nowhere", status=1)
    (tmp_path / "stopped").mkdir()
    said = call("push", empty, tmp_path / "stopped", status=1)
    assert "holds neither a completed session" in " ".join(said.split())


def test_list_shows_key_and_time_in_a_narrow_terminal(filled: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "80")
    (row,) = figures("list", filled, "--where", "object = 'amphora'")["sessions"]
    said = call("list", filled)
    assert row["key"][:7] in said
    assert datetime.fromtimestamp(row["captured_at"], UTC).strftime("%Y-%m-%d %H:%M") in said


def test_solve_settings_names_the_wrong_field(filled: Path, tmp_path: Path):
    wrong = tmp_path / "settings.json"
    wrong.write_text('{"colour_of_lamp": 1}')
    assert "settings.json: colour_of_lamp: " in call("solve", filled, "--settings", wrong, status=2)


def test_push_goes_on_after_a_damaged_session(empty: Path, session_folder: MakeSession):
    damaged, sound = session_folder("20261121-190041-aaaaaa", 1), session_folder("20261121-190041-bbbbbb", 2)
    (damaged / "passes/0/shots/1.tiff").write_bytes(b"")
    pushed = figures("push", empty, damaged, sound, status=1)
    assert pushed["new"] == 1
    assert list(pushed["refused"]) == [str(damaged)]


def test_list_and_show_find_by_condition_and_name(filled: Path):
    listed = figures("list", filled, "--where", "object ~ 'amph' and solver < '99'")["sessions"]
    shown = figures("show", filled, listed[0]["key"][:10])
    assert [row["object"] for row in listed] == ["amphora"]
    assert shown["session"]["session_id"] == "20261121-190041-bbbbbb"
    assert len(shown["results"]) == 2


def test_verify_damaged_archive_ends_with_status_one(filled: Path):
    assert figures("verify", filled)["faults"] == []
    damaged = next(path for path in sorted((filled / "objects").rglob("*")) if path.is_file())
    damaged.write_bytes(b"rot")
    faults = figures("verify", filled, status=1)["faults"]
    assert [fault["what"] for fault in faults] == ["damaged"]


@pytest.mark.parametrize("out", ["link", "file/out"])
def test_export_to_what_is_no_folder_is_named(filled: Path, tmp_path: Path, out: str):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    said = call("export", filled, "20261121-190041-a", "--out", tmp_path / out, status=2)
    assert said.startswith("folder.invalid")


def test_export_writes_a_folder(filled: Path, tmp_path: Path):
    call("export", filled, "20261121-190041-a", "--out", tmp_path / "out")
    assert (tmp_path / "out" / "recipe.json").is_file()


@pytest.fixture
def silent_address() -> Iterator[str]:
    """Address of a server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["create", "/sys/archive"], "archive.unreachable"),  # where not even root may write
        (["list", "NEWER"], "archive.catalogue_newer"),
        (["list", "ARCHIVE", "--where", "solver < '0.2'; drop table session"], "archive.query_invalid"),
        (["list", "ARCHIVE", "--where", "colour = 'red'"], "archive.query_invalid"),
        (["solve", "ARCHIVE", "--report", "NOWHERE/moved.html"], "request.invalid"),
        (["solve", "ARCHIVE", "--scheduler", "SILENT", "--settings", "OTHER"], "archive.no_scheduler"),
        (["solve", "ARCHIVE", "--scheduler", "nonsense://x", "--settings", "OTHER"], "archive.no_scheduler"),
        (["list", "ARCHIVE", "--where", "object ="], "archive.query_invalid"),
        (["list", "NOWHERE"], "archive.address_invalid"),
        (["show", "ARCHIVE", "zzz"], "archive.not_found"),
        (["serve", "NOWHERE"], "archive.address_invalid: NOWHERE: there is no such folder"),
        (["serve", "IMAGES"], "archive.address_invalid: IMAGES: holds no archive"),
        (["create", "IMAGES"], "archive.address_invalid: IMAGES holds other files"),
        (["list", "ARCHIVE", "--catalogue", "postgresql://127.0.0.1:9/x"], "archive.unreachable"),
        (["list", "s3//bucket"], "archive.address_invalid"),
        (["solve", "ARCHIVE", "--settings", "NOWHERE", "--local", "1"], "request.invalid"),
        (["solve", "ARCHIVE", "--scheduler", "tcp://127.0.0.1:9", "--settings", "OTHER"], "archive.no_scheduler"),
    ],
)
def test_bad_input_is_named_in_a_sentence(
    filled: Path, tmp_path: Path, session_folder: MakeSession, silent_address: str, arguments: list[str], complaint: str
):
    other = tmp_path / "other.json"
    other.write_text('{"depth_rounds": 1}')
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "001.png").touch()
    places = {
        "ARCHIVE": str(filled),
        "NEWER": str(newer_archive(tmp_path / "newer")),
        "IMAGES": str(tmp_path / "images"),
        "NOWHERE": str(tmp_path / "nowhere"),
        "NOWHERE/moved.html": str(tmp_path / "nowhere" / "moved.html"),
        "OTHER": str(other),
        "SESSION": str(session_folder("20261121-190041-cccccc", 3)),
        "SILENT": silent_address,
    }
    said = call(*(places.get(argument, argument) for argument in arguments), status=2)
    sentence, remedy = said.strip().splitlines()[-2:]
    for name in ("NOWHERE", "IMAGES"):
        complaint = complaint.replace(name, places[name])
    assert sentence.startswith(complaint)
    assert remedy.startswith("  What to do: ")


def newer_archive(folder: Path) -> Path:
    """An archive whose catalogue a later release has written."""
    Archive.create(str(folder)).close()
    newer = Catalogue(in_folder(folder))
    newer.repeatedly(lambda connection: connection.execute(meta.insert().values(format=99)).close())
    newer.close()
    return folder


def test_command_without_the_extra_says_what_to_install():
    program = "import sys; sys.modules['lark'] = None; from api.cli.commands import app; app(['archive', 'list', 'x'])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "lark is not installed: pip install 'lightpose[archive]'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_solve_by_local_processes_then_again_keeps(filled: Path, tmp_path: Path):
    settings = tmp_path / "settings.json"
    settings.write_text('{"depth_rounds": 1}')
    more = ("--settings", settings, "--local", 2, "--report", tmp_path / "moved.html")
    first = figures("solve", filled, *more)
    assert "amphora" in (tmp_path / "moved.html").read_text()
    again = figures("solve", filled, *more)
    assert (first["solved"], first["kept"], first["failed"]) == (2, 0, 0)
    assert (again["solved"], again["kept"], again["failed"]) == (0, 2, 0)
    assert len(first["moved"]) == 2
    assert again["moved"] == []
