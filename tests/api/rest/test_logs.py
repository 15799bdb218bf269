"""The log: each entry names its session, as text or JSON, and requests cannot inject lines."""

import json
import logging
import os
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from structlog.contextvars import bound_contextvars
from typer.testing import CliRunner

from acquisition.models.errors import RigError
from api.cli.commands import app
from api.rest import log_queue, logs, settings, standard_error

JSON_KEYS = {"event", "level", "logger", "timestamp"}


def written(captured: pytest.CaptureFixture[str]) -> str:
    """What standard error has received, once the log's thread has written all."""
    for handler in logging.getLogger().handlers:
        handler.flush()
    return captured.readouterr().err


def entries(captured: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in captured.splitlines()]


def test_log_entry_of_session_work_names_the_session(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("json")
    other = threading.Thread(target=lambda: logging.getLogger("elsewhere").info("meanwhile"))
    with bound_contextvars(session_id="20261121-101500-3f9c2a"):
        logging.getLogger("some.module").warning("the %s is dark", "frame")
        other.start()
        other.join()
    logging.getLogger("some.module").info("afterwards")
    try:
        raise ValueError("deep")
    except ValueError:
        logging.getLogger("some.module").exception("failed")

    first, meanwhile, afterwards, failed = entries(written(capsys))
    assert first.keys() == JSON_KEYS | {"session_id"}
    assert (first["event"], first["level"], first["logger"]) == ("the frame is dark", "warning", "some.module")
    assert first["session_id"] == "20261121-101500-3f9c2a"
    assert "session_id" not in meanwhile
    assert "session_id" not in afterwards
    assert "ValueError: deep" in failed["exception"]


def test_log_is_written_before_its_command_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What comes later, as here in the captured output that is closed then, ended in a traceback of `logging`."""
    emit = logging.StreamHandler[Any].emit

    def slow(self: logging.StreamHandler[Any], record: logging.LogRecord) -> None:
        time.sleep(0.5)
        emit(self, record)

    monkeypatch.setattr(logging.StreamHandler, "emit", slow)
    arguments = ["serve", "--cell", str(tmp_path / "no-such-cell.toml"), "--data", str(tmp_path)]
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2
    assert 0 < refused.stderr.find("descriptors") < refused.stderr.find("no-such-cell.toml")


def test_log_text_format_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("text")
    with bound_contextvars(session_id="20261121-101500-3f9c2a"):
        logging.getLogger("some.module").warning("dark")

    (line,) = written(capsys).splitlines()
    assert "dark" in line
    assert "session_id=20261121-101500-3f9c2a" in line
    assert "\x1b" not in line


def test_log_traceback_has_no_values_of_variables(capsys: pytest.CaptureFixture[str]) -> None:
    def fail(scope: dict[str, list[tuple[bytes, bytes]]]) -> None:
        raise ValueError(f"deep, beside {len(scope['headers'])} header")

    logs.configure("text")
    scope = {"headers": [(b"authorization", b"Bearer lp_" + b"secret")]}
    try:
        fail(scope)
    except ValueError:
        logging.getLogger("some.module").exception("failed")

    text = written(capsys)
    assert "ValueError: deep" in text
    assert "lp_secret" not in text
    assert len(text.splitlines()) < 15


def test_log_entry_waits_for_no_output_that_is_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    filled = 0
    try:
        while True:
            filled += os.write(write_end, 4096 * b"x")
    except BlockingIOError:
        os.set_blocking(write_end, True)
    with os.fdopen(read_end, "rb", buffering=0) as reader, os.fdopen(write_end, "w", buffering=1) as full:
        monkeypatch.setattr(sys, "stderr", full)
        monkeypatch.setattr(log_queue, "MOST_WAITING", 3)
        logs.configure("json")
        handler = logging.getLogger().handlers[0]
        handler.addFilter(lambda record: record.name == "some.module")  # services of other tests log, too
        caller = threading.Thread(
            target=lambda: [logging.getLogger("some.module").info("entry %d", number) for number in range(50)]
        )
        caller.start()
        caller.join(10)
        assert not caller.is_alive()

        received = b""
        while len(received) < filled or not received.endswith(b"\n"):
            received += reader.read(1 << 16)
        handler.flush()  # what waited fits into the pipe now
        logging.getLogger("some.module").info("afterwards")
        handler.close()
        received += reader.read(1 << 16)

    heard = entries(received[filled:].decode())
    assert heard[-1]["event"] == "afterwards"
    assert len(heard) <= 3 + 2
    assert sum(one.get("left_out", 0) for one in heard) == 51 - len(heard)  # told as often as there was room again


def test_request_log_names_caller_and_status(shared: Any, capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("json")
    made = shared.http.post("/v1/sessions", json={}).json()
    shared.http.post(f"/v1/sessions/{made['id']}/actions", json={"action": "resume"})
    shared.http.get(f"/v1/sessions/{made['id']}")
    shared.http.get("/v1/sessions/nope%0a%7B%22event%22:%22forged%22%7D")
    shared.http.post("/v1/rig/stop", headers={"Origin": "http://evil.example"})

    heard: list[dict[str, Any]] = []
    deadline = time.monotonic() + 60
    while len(heard) < 4 and time.monotonic() < deadline:  # an entry is written after its answer is sent
        heard += [entry for entry in entries(written(capsys)) if entry["event"] == "request"]
        time.sleep(0.01)
    assert [(entry["method"], entry["status"]) for entry in heard] == [
        ("POST", 201), ("POST", 409), ("GET", 404), ("POST", 403),
    ]  # fmt: skip
    created, refused, missing, foreign = heard
    assert created["by"] == "operator"
    assert created["ms"] > 0
    assert refused["session_id"] == made["id"]
    assert missing["path"].endswith("%0a%7B%22event%22:%22forged%22%7D")
    assert foreign["by"] == "nobody"


def test_log_format_comes_from_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("LIGHTPOSE_LOG", "json")
    assert settings.read(cell=tmp_path).log == "json"
    assert settings.read(cell=tmp_path, log="text").log == "text"


def test_logs_rate_limit_keeps_warnings_and_counts_what_is_left_out() -> None:
    limit = logs.RateLimit()

    def entries(level: int, count: int) -> list[logging.LogRecord]:
        made = [logging.LogRecord("a", level, "", 0, "", (), None) for _ in range(count)]
        return [record for record in made if limit.filter(record)]

    begun = time.monotonic()
    requests = entries(logging.INFO, 5000)
    warnings = entries(logging.WARNING, 10)
    time.sleep(2 / logs.ENTRIES_PER_S)
    later = entries(logging.INFO, 1)
    lasted_s = time.monotonic() - begun

    assert logs.BURST <= len(requests) <= logs.BURST + 1 + lasted_s * logs.ENTRIES_PER_S
    assert len(warnings) == 10
    assert sum(getattr(entry, "left_out", 0) for entry in [*requests, *later]) == 5000 - len(requests)


def test_logs_json_holds_warnings_and_no_colour_codes(capsys: pytest.CaptureFixture[str]) -> None:
    logging.captureWarnings(False)  # as a test before has left it
    logs.configure("json")
    try:
        warnings.warn("invalid value encountered", RuntimeWarning, stacklevel=1)
        logging.getLogger("uvicorn.error").info(
            "started [%d]", 7, extra={"color_message": "started [\x1b[36m%d\x1b[0m]"}
        )
        text = written(capsys)
    finally:
        logging.captureWarnings(False)

    assert [entry["logger"] for entry in entries(text)] == ["py.warnings", "uvicorn.error"]
    assert "color_message" not in text


def damaged_pngs(size: int, count: int) -> list[bytes]:
    """PNG files of a camera's size with bytes changed after the header, by a fixed seed."""
    generator = np.random.default_rng(22)
    content = cv2.imencode(".png", generator.integers(0, 256, (size, size), np.uint8))[1].tobytes()[:60_000]
    made: list[bytes] = []
    for _ in range(count):
        damaged = np.frombuffer(content, np.uint8).copy()
        damaged[generator.integers(33, 2000, 20)] = generator.integers(0, 256, 20)
        made.append(damaged.tobytes())
    return made


def test_logs_json_holds_what_c_libraries_print(shared: Any, capfd: pytest.CaptureFixture[str]) -> None:
    made = shared.client.create()
    logs.configure("json")
    with standard_error.as_entries():
        for content in damaged_pngs(1024, 20):
            headers = {"Content-Type": "image/png"}
            shared.http.put(f"/v1/sessions/{made.id}/region.png", content=content, headers=headers)
        subprocess.run(["sh", "-c", "echo from a child >&2; printf 'no end' >&2"], check=True)
        logging.getLogger("some.module").info("meanwhile")

    logged = entries(written(capfd))
    foreign = [entry["event"] for entry in logged if entry["logger"] == "stderr"]
    assert any(line.startswith("libpng") for line in foreign)
    assert foreign[-2:] == ["from a child", "no end"]
    assert "meanwhile" in {entry["event"] for entry in logged}


def test_standard_error_flood_holds_up_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    logs.configure("json")
    with standard_error.as_entries():
        os.write(2, 20_000 * b"y\n")
        subprocess.run(["sh", "-c", "yes | head -c 300000 >&2"], check=False, timeout=60)
    os.write(2, b"as before\n")

    *logged, last = written(capfd).splitlines()
    assert last == "as before"
    assert 0 < len(entries("\n".join(logged))) < 2000


def test_logs_file_rotates_and_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "FILE_BYTES", 1_000)
    monkeypatch.setattr(logs, "OLD_FILES", 2)
    logs.configure("json", tmp_path / "lightpose.log")

    for number in range(100):
        logging.getLogger("some.module").info("entry %d", number)
    logging.getLogger().handlers[0].flush()

    names = sorted(file.name for file in tmp_path.iterdir())
    assert names == ["lightpose.log", "lightpose.log.1", "lightpose.log.2"]
    assert all((tmp_path / name).stat().st_size <= 1_000 for name in names)
    newest = entries((tmp_path / "lightpose.log").read_text(encoding="utf-8"))
    assert newest[-1]["event"] == "entry 99"


def test_logs_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no-folder"):
        logs.configure("text", tmp_path / "no-folder" / "lightpose.log")
