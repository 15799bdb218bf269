"""The command line: help, errors, exit codes, environment variables."""

import contextlib
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import httpx
import pytest
import typer
from typer.testing import CliRunner

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import Trigger
from acquisition.store import Store
from api.cli.commands import app
from tests.acquisition.formats.folders import small

ROOT = Path(__file__).parents[3]


def lightpose(*arguments: str, timeout_s: float = 100.0) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "api.cli", *arguments],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=timeout_s,
    )  # fmt: skip


def test_help_loads_neither_kernels_nor_http_library() -> None:
    script = (
        "import sys\nfrom typer.testing import CliRunner\nfrom api.cli.commands import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\n"
        "print([name for name in ('numba', 'scipy', 'cv2', 'trimesh', 'fastapi', 'httpx') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("demo", "--object", "teapot"), "teapot"),
        (("demo", "--method", "magic"), "method"),
        (("demo", "--planned", "-3"), "--planned -3: "),
        (("demo", "--lights", "a.txt"), "--method user"),
        (("demo", "--method", "user"), "--lights: "),
        (("demo", "--pixels", "3"), "--pixels"),
        (("sim", "--object", "teapot"), "sphere"),
        (("demo", "--object", "vase", "--mesh", "a.stl"), "only one"),
        (("sim", "--mesh", "a.stl", "--family", "knot"), "only one"),
        (("demo", "--object", "vase", "--size-mm", "80"), "--size-mm"),
        (("demo", "--mesh", "no-such.stl"), "no-such.stl"),
        (("sim", "--mesh", "no-such.step"), ".ply"),
        (("demo", "--family", "teapots"), "vessel"),
        (("sim", "--reflectance", "velvet"), "oren-nayar"),
        (("sim", "--profile", "dreamy"), "dreamy"),
        (("sim", "--address", "10.1.2.3"), "10.1.2.3: choose a loopback address"),
        (("demo", "--speed", "0"), "--speed"),
        (("sim", "--pixels", "8"), "--pixels"),
        (("place", "vase", "--port", "70000"), "--port"),
        (("archive", "serve", "archive", "--port", "70000"), "--port"),
        (("calibrate", "board", "--square-mm", "0.5"), "--square-mm 0.5: give more than 1 and less than 500 mm"),
        (("serve",), "LIGHTPOSE_CELL: is not set: set it, or give --cell"),
        (("keys", "revoke", "nobody"), "Correct the option"),
        (("prune",), "Correct the name or the folder"),
        (("serve", "--cell", "no-such-cell.toml"), "no-such-cell.toml"),
        (("keys", "revoke", "nobody"), "request.invalid: There is no key named"),
        (("prune", "--dry-run"), "Correct the name or the folder"),
        (("place", "vase", "--address", "127.0.0.9"), "lightpose sim"),
        (("replay", "no-such-folder"), "is not a folder"),
        (("solve", "no-such-folder"), "no-such-folder"),
        (("serve", "--cell", "hardware_sim/cells/cell.sim.toml", "--host", "0.0.0.0"), "lightpose keys add"),  # noqa: S104
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_command_bad_input_exits_2_and_names_remedy(
    arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("LIGHTPOSE_CELL", raising=False)
    more = ("--data", str(tmp_path)) if arguments[0] in ("demo", "serve", "keys", "prune") else ()
    done = CliRunner().invoke(app, [*arguments, *more])
    assert done.exit_code == 2
    assert said in done.stdout + done.stderr
    assert "pydantic" not in done.stdout + done.stderr  # its links and headings say nothing to a user
    assert isinstance(done.exception, SystemExit)  # a printed message, not a traceback


@pytest.mark.parametrize(
    "arguments",
    [
        ("solve", "SESSION", "--out", "SESSION"),
        ("solve", "SESSION", "--out", "SESSION/normals"),
        ("solve", "IMAGES", "--out", "SESSION/results/2"),
        ("plan", "SESSION", "--count", "1", "--out", "SESSION/plan.json"),
        ("archive", "create", "SESSION/archive"),
        ("archive", "export", "ARCHIVE", "2026", "--out", "SESSION/out"),
        ("archive", "solve", "ARCHIVE", "--report", "SESSION/report.html"),
        ("calibrate", "board", "--out", "SESSION/board.pdf"),
        ("calibrate", "response", "IMAGES", "--base", "SESSION/calibration.json", "--out", "SESSION/response"),
        ("study", "--quick", "--out", "SESSION/study"),
        ("sim", "--folder", "SESSION"),
        ("demo", "--data", "SESSION/demo"),
    ],
)
def test_output_within_a_sessions_folder_is_refused(arguments: tuple[str, ...], tmp_path: Path) -> None:
    """Another file there would be archived as part of the session, under another key, and `sim` replaces its files."""
    session, archive = tmp_path / "20261121-190041-de2be6", tmp_path / "archive"
    shutil.copytree(ROOT / "tests/data/release_0.1/sessions/20261121-190041-de2be6", session)
    CliRunner().invoke(app, ["archive", "create", str(archive)])
    CliRunner().invoke(app, ["archive", "push", str(archive), str(session)])
    places = {"IMAGES": small.lp(tmp_path / "images"), "ARCHIVE": archive}
    before = {path: path.read_bytes() for path in session.rglob("*") if path.is_file()}
    given = [str(places.get(word, word.replace("SESSION", str(session)))) for word in arguments]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2
    assert "folder.invalid: " in done.output
    assert str(session) in done.output
    assert {path: path.read_bytes() for path in session.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    "arguments",
    [
        ("serve", "--cell", "cell.toml", "--host", "0.0.0.0"),  # noqa: S104 - without the refusal: no keys, no service
        ("keys", "add", "lab"),
        ("keys", "list"),
    ],
)
@pytest.mark.parametrize("below", ["", "results"])
def test_sessions_folder_is_refused_as_a_data_folder(arguments: tuple[str, ...], below: str, tmp_path: Path) -> None:
    """One made in there would be archived as part of the session, and its keys would admit nobody to the service."""
    data = tmp_path / "data"
    session = data / "sessions" / "20261121-190041-de2be6"
    shutil.copytree(ROOT / "tests/data/release_0.1/sessions/20261121-190041-de2be6", session)
    before = sorted(session.rglob("*"))

    def refused() -> str:
        done = CliRunner().invoke(app, [*arguments, "--data", str(session / below)])
        assert done.exit_code == 2
        assert "folder.invalid: " in done.stderr
        assert sorted(session.rglob("*")) == before
        return done.stderr

    assert "name a folder outside it" in refused()
    (data / "rig.db").touch()
    assert f"name the data folder that holds this session: {data}\n" in refused()


@pytest.mark.parametrize("below", ["sessions", "calibrations", "cache/previews"])
def test_folder_kept_by_a_service_is_refused_as_a_data_folder(below: str, tmp_path: Path) -> None:
    """A folder of that name that belongs to no data folder may be one."""
    data = tmp_path / "data"
    kept = data / below

    def listed() -> Any:
        return CliRunner().invoke(app, ["keys", "add", "lab", "--data", str(kept)])

    assert listed().exit_code == 0
    shutil.rmtree(kept)
    (data / "rig.db").touch()
    done = listed()
    assert done.exit_code == 2
    assert f"folder.invalid: {kept} is no data folder: it lies in the data folder {data}" in done.stderr
    assert f"name the data folder that holds it: {data}\n" in done.stderr
    assert not kept.exists()


def every_command(command: Any, name: str = "lightpose") -> Iterator[tuple[str, Any]]:
    yield name, command
    for own, inner in getattr(command, "commands", {}).items():
        yield from every_command(inner, f"{name} {own}")


def test_help_of_every_command_is_complete() -> None:
    """Each argument and option says what it is; a switch has no second name; summaries are not cut."""
    for name, command in every_command(typer.main.get_command(app)):
        said = CliRunner().invoke(app, [*name.split()[1:], "--help"], terminal_width=80).output
        assert "..." not in said.replace("folders...", "").replace("{folders}...", "").replace("[ARGS]...", ""), name
        for one in command.params:
            assert one.help, f"{name}: {one.name}"
            assert one.name == "random" or not one.secondary_opts, f"{name}: {one.name}"


def test_check_is_of_the_services_cell_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("LIGHTPOSE_CELL", str(tmp_path / "lab.toml"))
    done = CliRunner().invoke(app, ["check", "--offline"])
    assert done.exit_code == 1
    assert "lab.toml" in done.output


def test_version_is_that_of_the_package() -> None:
    done = lightpose("--version")
    assert (done.returncode, done.stdout) == (0, f"lightpose {metadata.version('lightpose')}\n")


def test_keys_and_prune_find_the_services_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTPOSE_DATA", str(tmp_path))
    runner = CliRunner()
    empty = runner.invoke(app, ["keys", "list"])
    assert "only this machine can connect" in empty.stderr
    assert runner.invoke(app, ["keys", "add", "lab"]).exit_code == 0
    assert (tmp_path / "keys.json").is_file()
    assert runner.invoke(app, ["keys", "list"]).stdout.startswith("lab\toperator")
    runner.invoke(app, ["keys", "revoke", "lab"])
    assert "refuses everybody" in runner.invoke(app, ["keys", "list"]).stderr
    assert str(tmp_path) in runner.invoke(app, ["prune"]).stderr  # it has no journal yet


def test_command_error_exits_without_traceback() -> None:
    done = lightpose("archive", "list", "no-such-folder")
    assert done.returncode == 2
    assert "no-such-folder" in done.stderr
    assert "What to do" in done.stderr
    assert "Traceback" not in done.stderr


def test_check_offline_reports_reach_and_route() -> None:
    offline = lightpose("check", "--offline")
    assert offline.returncode == 0, offline.stderr
    assert "positions on the dome" in offline.stdout
    assert "route of the pilot" in offline.stdout


@pytest.mark.long
def test_demo_page_serves_until_interrupted(tmp_path: Path) -> None:
    # A shell lets what it runs in the background ignore Ctrl-C, and children inherit that.
    command = ["env", "--default-signal=INT", sys.executable, "-u", "-m", "api.cli", "demo", "--page"]
    command += ["--object", "sphere", "--pixels", "64", "--data", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process, contextlib.ExitStack() as ending:
        ending.callback(process.kill)
        assert process.stdout is not None
        address = next(line.split()[1] for line in process.stdout if line.startswith("page "))
        answer = httpx.get(address)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    assert answer.status_code == 200
    assert "operators-page" in answer.text


@pytest.mark.long
def test_demo_json_prints_one_object_as_last_line(tmp_path: Path) -> None:
    """Also where an earlier one was broken off amid its session."""
    with contextlib.closing(Store(tmp_path / "data")) as store:
        broken_off = store.journal.create_session(Recipe(), "{}", "fingerprint")[0].id
        store.journal.trigger(broken_off, Trigger.START, "a")
        store.journal.record_fault(ErrorCode.DEVICE_DISCONNECTED, "The link to the arm is lost")
    done = lightpose(
        "demo", "--object", "sphere", "--profile", "ideal", "--pixels", "96", "--speed", "30", "--pilot", "3",
        "--planned", "2", "--no-random", "--data", str(tmp_path), "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert outcome["object"] == "sphere"
    assert outcome["lights_total"] == 5
    assert outcome["random_mean_deg"] is None
    assert outcome["mean_deg"] < 2.0
    assert outcome["mean_deg"] < outcome["pilot_mean_deg"]
    assert (Path(outcome["results"]) / "normals.png").exists()
    assert set(outcome["seconds"]) >= {"pilot", "waypoints", "capture", "normals", "plan", "total"}


def test_demo_beside_running_demo_keeps_its_cell(tmp_path: Path) -> None:
    truth = tmp_path / "cell" / "truth.npz"
    truth.parent.mkdir()
    truth.write_bytes(b"of the running one")
    with contextlib.closing(Store(tmp_path / "data")):
        done = CliRunner().invoke(app, ["demo", "--object", "sphere", "--pixels", "96", "--data", str(tmp_path)])
    assert done.exit_code == 2
    assert "store.locked" in done.stdout + done.stderr
    assert truth.read_bytes() == b"of the running one"


def test_serve_missing_options_come_from_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """So a unit file needs no arguments; the cell that is named there is not there, which ends it."""
    monkeypatch.setenv("LIGHTPOSE_CELL", str(tmp_path / "of-the-environment.toml"))
    monkeypatch.setenv("LIGHTPOSE_HOST", "0.0.0.0")  # noqa: S104
    monkeypatch.setenv("LIGHTPOSE_DATA", str(tmp_path))
    refused = CliRunner().invoke(app, ["serve"])
    without_service = CliRunner().invoke(app, ["serve", "--host", "127.0.0.1"])
    assert refused.exit_code == without_service.exit_code == 2
    assert "does not listen on '0.0.0.0' without keys" in refused.stderr
    assert "of-the-environment.toml" in without_service.stderr
