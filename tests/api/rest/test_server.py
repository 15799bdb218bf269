"""The server process: addresses, settings, start and shutdown."""

import contextlib
import io
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import httpx
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.store import Store
from api.rest import server, settings, wiring

HEAVY = ("numba", "trimesh", "embreex", "matplotlib", "rtde_control", "rtde_receive", "hardware_sim")


@contextmanager
def process(cell_file: Path, data: Path) -> Generator[tuple[subprocess.Popen[str], str]]:
    code = (
        "import sys; from pathlib import Path; from api.rest import server, settings; "
        "server.serve(settings.read(cell=Path(sys.argv[1]), data=Path(sys.argv[2]), host='127.0.4.4', port=0))"
    )
    started = subprocess.Popen(
        [sys.executable, "-c", code, str(cell_file), str(data)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert started.stdout is not None
        line = started.stdout.readline()
        assert line.startswith("ready http://127.0.4.4:"), started.communicate()[1]
        yield started, line.removeprefix("ready ").strip()
    finally:
        started.kill()
        started.communicate()


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "lab-server", "example.org"])  # noqa: S104
def test_create_foreign_host_without_keys_is_refused(cell_file: Path, tmp_path: Path, host: str) -> None:
    with pytest.raises(RigError) as refused:
        server.create(settings.read(cell=cell_file, data=tmp_path / "data", host=host))

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert "SSH tunnel" in refused.value.detail
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.4.2", "::1", "localhost"])
def test_is_loopback_accepts_several_names(host: str) -> None:
    settings.refuse_open_bind(host, keys=False)


def test_create_foreign_host_with_keys_is_allowed() -> None:
    settings.refuse_open_bind("0.0.0.0", keys=True)  # noqa: S104


@pytest.mark.parametrize(
    ("given", "name"),
    [({"port": 70000}, "LIGHTPOSE_PORT"), ({"host": ""}, "LIGHTPOSE_HOST"), ({"colour": 1}, "LIGHTPOSE_COLOUR")],
)
def test_settings_invalid_value_names_the_variable(cell_file: Path, given: dict[str, Any], name: str) -> None:
    with pytest.raises(RigError, match=name) as refused:
        settings.read(cell=cell_file, **given)

    assert refused.value.code is ErrorCode.CONFIG_INVALID


def test_settings_are_read_from_environment(monkeypatch: pytest.MonkeyPatch, cell_file: Path) -> None:
    monkeypatch.setenv("LIGHTPOSE_CELL", str(cell_file))
    monkeypatch.setenv("LIGHTPOSE_PORT", "8123")
    monkeypatch.setenv("LIGHTPOSE_ALLOWED_ORIGINS", "http://a.example, HTTP://B.example/")

    read = settings.read(port=8124)

    assert (read.cell, read.port) == (cell_file, 8124)
    assert read.allowed_origins == ("http://a.example", "http://b.example")


def test_create_missing_cell_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigError) as refused:
        server.create(settings.read(cell=tmp_path / "nothing.toml", data=tmp_path / "data"))

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert "nothing.toml" in refused.value.detail


def test_create_data_folder_in_use_is_refused(own: Any) -> None:
    with pytest.raises(RigError) as refused:
        server.create(own.settings)

    assert refused.value.code is ErrorCode.STORE_LOCKED


def test_serve_damaged_database_ends_with_a_remedy(cell_file: Path, tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "rig.db").write_bytes(b"no database" * 1000)
    command = [sys.executable, "-m", "api.cli", "serve", "--cell", str(cell_file), "--data", str(tmp_path / "data")]

    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    assert ended.returncode == 2
    assert f"{ErrorCode.STORE_CORRUPT}: The journal rig.db is damaged: file is not a database" in ended.stderr
    assert "What to do: Restore" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_serve_port_in_use_is_refused_before_the_arm_is_touched(
    cell_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another service may listen there and move the arm: to connect or to halt would end its program."""
    touched: list[str] = []
    monkeypatch.setattr(wiring.Service, "open", lambda _: touched.append("open"))
    monkeypatch.setattr(wiring.Service, "close", lambda _: touched.append("close"))
    with socket.create_server(("127.0.4.5", 0)) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(RigError, match=f"127.0.4.5:{port}") as refused:
            server.serve(settings.read(cell=cell_file, data=tmp_path / "data", host="127.0.4.5", port=port))

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert touched == []
    with contextlib.closing(Store(tmp_path / "data")):
        pass  # the data folder is free again


def test_signal_while_lock_is_held_halts_the_arm(own: Any) -> None:
    """The handler may find the stop token locked by the very thread that it interrupts."""
    runner = own.service.runner
    with runner._token._cond:
        own.server.handle_exit(signal.SIGTERM, None)
        assert not runner._token.is_set()

    assert runner._token.wait(60)
    assert runner.closing.is_set()
    own.server._captured_signals.clear()  # so that uvicorn does not raise it again in this process


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)])
def test_shutdown_with_open_event_stream_is_orderly(cell_file: Path, tmp_path: Path, number: int) -> None:
    with (
        process(cell_file, tmp_path / "data") as (started, url),
        httpx.stream("GET", f"{url}/v1/events?after=0", timeout=60) as answer,
    ):
        parts = answer.iter_text()
        next(parts)
        os.kill(started.pid, number)
        assert all(part is not None for part in parts)  # the stream ends, it does not break
        _, errors = started.communicate(timeout=60)

    assert started.returncode == (-signal.SIGTERM if number == signal.SIGTERM else 0)
    assert "Traceback" not in errors
    assert "Finished server process" in errors  # the last entry is not lost with the process


def test_service_import_loads_no_kernel_and_no_ray_tracer() -> None:
    code = (
        "import sys, api.rest.app, api.rest.server, api.rest.wiring, api.client; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )

    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert completed.stdout.strip() == "[]"


def test_announce_is_one_write(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a buffer each write is one of the file's, and the log may write to the same file between two."""
    writes: list[bytes] = []

    class File(io.RawIOBase):
        def writable(self) -> bool:
            return True

        def write(self, data: Any) -> int:
            writes.append(bytes(data))
            return len(data)

    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(cast("Any", File()), write_through=True))
    server.announce("http://127.0.0.1:8000")
    assert writes == [b"ready http://127.0.0.1:8000\n"]
