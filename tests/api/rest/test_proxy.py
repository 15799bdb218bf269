"""Debian's Caddy and nginx before the service, as the page on TLS configures them: origin, stop, events at once."""

import re
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.rest import keys
from api.rest.keys import Role

pytestmark = pytest.mark.long

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "serve-over-tls.md"
HOST = "localhost"
WITHIN_S = 60.0


def configured(name: str, backend: str, port: int, folder: Path) -> list[str]:
    """Writes a proxy's configuration, the page's but for addresses and files; the command that runs it."""
    stated = re.search(rf"## {name}\n\n```\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert stated is not None
    text = re.sub(r"/etc/(caddy|nginx)/", f"{folder}/", stated[1])
    text = text.replace("127.0.0.1:8000", backend).replace("lab-computer", HOST)
    file = folder / f"{name}.conf"
    if name == "Caddy":
        start = f"{{\n\tadmin off\n\tauto_https disable_redirects\n\tstorage file_system {folder}/caddy\n}}\n"
        file.write_text(start + text.replace(f"https://{HOST}", f"https://{HOST}:{port}"), encoding="utf-8")
        return ["caddy", "run", "--config", str(file), "--adapter", "caddyfile"]
    text = text.replace("listen 443 ssl", f"listen 127.0.0.1:{port} ssl")
    file.write_text(
        f"daemon off; pid {folder}/nginx.pid; error_log {folder}/error.log; events {{}}\n"
        f"http {{ access_log off; client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy;\n"
        f"fastcgi_temp_path {folder}/f; uwsgi_temp_path {folder}/u; scgi_temp_path {folder}/s;\n{text}}}\n",
        encoding="utf-8",
    )
    return ["nginx", "-c", str(file)]


@contextmanager
def proxy(name: str, backend: str, folder: Path) -> Generator[str]:
    """A running proxy; its address."""
    if shutil.which(name.lower()) is None:
        pytest.skip(f"needs {name}: apt-get install {name.lower()}")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with (folder / "proxy.log").open("wb") as log:
        process = subprocess.Popen(configured(name, backend, port, folder), stdout=log, stderr=log)
    try:
        deadline = time.monotonic() + WITHIN_S
        while True:
            assert process.poll() is None, (folder / "proxy.log").read_text(encoding="utf-8")
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.05)
        yield f"https://{HOST}:{port}"
    finally:
        process.terminate()
        process.wait(60)


@pytest.mark.parametrize("name", ["Caddy", "nginx"])
def test_proxy_passes_page_stop_and_events_at_once(
    name: str, start: Callable[..., AbstractContextManager[Any]], tmp_path: Path
) -> None:
    subprocess.run(
        [
            "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
            "-keyout", tmp_path / "key.pem", "-out", tmp_path / "cert.pem", "-days", "2", "-subj", "/CN=lightpose",
            "-addext", f"subjectAltName=DNS:{HOST}",
        ],
        check=True, capture_output=True,
    )  # fmt: skip
    secret = keys.add(keys.path_in(tmp_path / "data"), "anna", Role.OPERATOR)
    trusting = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
    with (
        start(trusted_proxies=("127.0.0.1",)) as service,
        proxy(name, service.url.removeprefix("http://"), tmp_path) as url,
        httpx.Client(
            base_url=url, verify=trusting, timeout=WITHIN_S, trust_env=False,
            headers={"Authorization": f"Bearer {secret}", "Origin": url},
        ) as http,
    ):  # fmt: skip
        assert http.get("/").headers["content-type"].startswith("text/html")
        with http.stream("GET", "/v1/events") as events:
            parts = events.iter_text()
            heard = next(parts)  # the stream's head arrives before there is any event
            made = http.post("/v1/sessions", json={})
            while "session.created" not in heard:
                heard += next(parts)
            stopped = http.post("/v1/rig/stop")
            while "safety.changed" not in heard:
                heard += next(parts)
        foreign = http.post("/v1/sessions", json={}, headers={"Origin": "https://evil.example"})
        actor = service.service.store.journal.actions(made.json()["id"])
        fault = service.service.runner.status().latched

    assert (made.status_code, stopped.status_code, foreign.status_code) == (201, 202, 403)
    assert made.headers["location"].startswith("/v1/sessions/")
    assert fault is not None
    assert "anna@127.0.0.1" in fault.detail, (fault.detail, actor)
