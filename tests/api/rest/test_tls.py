"""TLS of the service itself: the stop on the listener's thread, streams, large answers, refusals of bad files."""

import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import httpx
import pytest

from acquisition.models.errors import ErrorCode, RigError
from api import Client
from api.rest import tls

ADDRESS = "127.0.4.2"
WITHIN_S = 60.0

Start = Callable[..., AbstractContextManager[Any]]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate of its own authority, and its key."""
    if shutil.which("openssl") is None:
        pytest.skip("needs OpenSSL: apt-get install openssl")
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = folder / "cert.pem", folder / "key.pem"
    subprocess.run(
        [
            "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
            "-keyout", key, "-out", certificate, "-days", "2", "-subj", "/CN=lightpose",
            "-addext", f"subjectAltName=IP:{ADDRESS}",
        ],
        check=True, capture_output=True,
    )  # fmt: skip
    key.chmod(0o600)
    return certificate, key


@pytest.fixture(scope="module")
def trusting(files: tuple[Path, Path]) -> ssl.SSLContext:
    """A client's context that trusts the certificate."""
    return ssl.create_default_context(cafile=str(files[0]))


@pytest.fixture
def encrypted(files: tuple[Path, Path], start: Start, monkeypatch: pytest.MonkeyPatch) -> Generator[Any]:
    monkeypatch.setenv("SSL_CERT_FILE", str(files[0]))
    with start(tls_cert=files[0], tls_key=files[1]) as running:
        yield running


def test_tls_session_events_and_large_answers(encrypted: Any, trusting: ssl.SSLContext) -> None:
    with httpx.Client(base_url=encrypted.url, verify=trusting, timeout=WITHIN_S) as http:
        made = http.post("/v1/sessions", json={}, headers={"Origin": encrypted.url})
        script = http.get("/docs/swagger-ui-bundle.js", headers={"Accept-Encoding": "identity"})
        foreign = http.post("/v1/sessions", json={}, headers={"Origin": encrypted.url.replace("https", "http")})
        with http.stream("GET", "/v1/events?after=0") as stream:
            text = ""
            for part in stream.iter_text():
                text += part
                if "session.created" in text:
                    break
    with Client(encrypted.url) as client:
        assert client.session(made.json()["id"]).state == "created"

    assert encrypted.url.startswith("https://")
    assert made.status_code == 201
    assert len(script.content) > 1_000_000
    assert foreign.json()["code"] == ErrorCode.REQUEST_FOREIGN


def test_tls_stop_with_blocked_event_loop_is_answered(encrypted: Any, trusting: ssl.SSLContext) -> None:
    blocked, done = threading.Event(), threading.Event()

    def block() -> None:
        blocked.set()
        done.wait(WITHIN_S)

    encrypted.server.loop.call_soon_threadsafe(block)
    assert blocked.wait(WITHIN_S)
    try:
        headers = {"Origin": encrypted.url}
        answer = httpx.post(
            f"{encrypted.url}/v1/rig/stop", content=b"now", verify=trusting, timeout=WITHIN_S, headers=headers
        )
        halts = encrypted.service.runner.halts
    finally:
        done.set()

    assert (answer.status_code, halts) == (202, 1)
    assert answer.json()["links"]["rig"] == "/v1/rig"


@pytest.mark.parametrize(
    "greeting", [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01\x00\x05hello", b"\x00" * 300]
)
def test_tls_what_is_none_is_closed_and_harms_nobody(encrypted: Any, trusting: ssl.SSLContext, greeting: bytes) -> None:
    port = int(encrypted.url.rpartition(":")[2])
    with socket.create_connection((ADDRESS, port), WITHIN_S) as opened:
        opened.sendall(greeting)
        answer = b""
        try:
            while block := opened.recv(4096):
                answer += block
        except ConnectionResetError:
            pass
    assert b"HTTP" not in answer
    assert httpx.get(f"{encrypted.url}/health/live", verify=trusting, timeout=WITHIN_S).status_code == 200


def test_tls_connection_is_kept_for_several_requests(encrypted: Any, trusting: ssl.SSLContext) -> None:
    port = int(encrypted.url.rpartition(":")[2])
    with (
        socket.create_connection((ADDRESS, port), WITHIN_S) as plain,
        trusting.wrap_socket(plain, server_hostname=ADDRESS) as opened,
    ):
        for _ in range(3):
            opened.sendall(b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n")
            answer = b""
            while not answer.endswith(b'"}'):
                answer += opened.recv(4096)
            assert answer.startswith(b"HTTP/1.1 200 ")
        opened.sendall(b"GET /health/live HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        assert opened.recv(4096).startswith(b"HTTP/1.1 200 ")
        while opened.recv(4096):
            pass


def test_tls_bad_files_are_refused_by_name(files: tuple[Path, Path], tmp_path: Path) -> None:
    certificate, key = files
    (tmp_path / "other.pem").write_text("no key\n", encoding="utf-8")
    (tmp_path / "other.pem").chmod(0o600)
    (tmp_path / "open.pem").write_bytes(key.read_bytes())
    (tmp_path / "open.pem").chmod(0o644)
    for given, told in (
        ((certificate, None), "--tls-key"),
        ((None, key), "--tls-cert"),
        ((tmp_path / "missing.pem", key), "missing.pem cannot be read"),
        ((certificate, tmp_path / "missing.pem"), "missing.pem cannot be read"),
        ((certificate, tmp_path / "other.pem"), "other.pem are not a matching certificate and key"),
        ((certificate, tmp_path / "open.pem"), "open.pem can be read"),
        ((key, key), "are not a matching certificate and key"),
    ):
        with pytest.raises(RigError) as refused:
            tls.context(*given)
        assert refused.value.code is ErrorCode.CONFIG_INVALID
        assert told in refused.value.detail
