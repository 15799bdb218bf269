"""Servers asked with the standard library whether they answer, over real sockets."""

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from acquisition.archive import answering
from acquisition.models.errors import ErrorCode, RigError

HEAVY = {"dask", "distributed", "fsspec", "numba", "numpy", "scipy", "sqlalchemy", "s3fs"}


@pytest.fixture
def silent() -> Iterator[str]:
    """Host and port of a server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0), backlog=64) as server:
        yield f"127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture
def closed() -> str:
    """Host and port at which nothing listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture
def talking() -> Iterator[str]:
    """Host and port of a server that answers each connection with one byte."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection:
                    connection.sendall(b"N")

        thread = threading.Thread(target=answer)
        thread.start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


def ask(kind: str, at: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asks a server of a kind whether it answers."""
    if kind in ("http", "https"):
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"{kind}://{at}")
        answering.require_store("s3://bucket/archive")
    elif kind == "postgresql":
        answering.require_catalogue(f"postgresql://user:secret@{at}/lightpose")
    else:
        answering.require_scheduler(f"{kind}://{at}")


@pytest.mark.parametrize("kind", ["http", "https", "postgresql", "tcp", "tls", "ws"])
@pytest.mark.parametrize("fault", ["closed", "silent"])
def test_server_that_does_not_answer_is_named(
    kind: str, fault: str, silent: str, closed: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(answering, "ANSWER_S", 0.3)
    at = silent if fault == "silent" else closed
    with pytest.raises(RigError, match="no answer within 0.3 s" if fault == "silent" else "refused") as refused:
        ask(kind, at, monkeypatch)
    scheduler = kind in ("tcp", "tls", "ws")
    assert refused.value.code is (ErrorCode.ARCHIVE_NO_SCHEDULER if scheduler else ErrorCode.ARCHIVE_UNREACHABLE)
    assert at in refused.value.detail
    assert "secret" not in refused.value.detail


@pytest.mark.parametrize("kind", ["http", "https", "postgresql", "tcp", "tls", "ws"])
def test_server_that_says_anything_is_left_to_its_client(kind: str, talking: str, monkeypatch: pytest.MonkeyPatch):
    ask(kind, talking, monkeypatch)


@pytest.mark.parametrize("address", ["nonsense://x", "127.0.0.1:8786", "tcp://127.0.0.1:port", "tcp://127.0.0.1:70000"])
def test_address_of_no_scheduler_is_refused(address: str):
    with pytest.raises(RigError) as refused:
        answering.require_scheduler(address)
    assert refused.value.code is ErrorCode.ARCHIVE_NO_SCHEDULER


def test_server_that_hangs_up_does_not_answer(monkeypatch: pytest.MonkeyPatch):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def hang_up() -> None:
            server.accept()[0].close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        with pytest.raises(RigError, match=r"closed the connection|reset"):
            ask("tcp", f"127.0.0.1:{server.getsockname()[1]}", monkeypatch)
        thread.join()


def test_folder_and_sqlite_need_no_server(monkeypatch: pytest.MonkeyPatch, closed: str):
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{closed}")
    answering.require_store("/mnt/archive")
    answering.require_catalogue("sqlite:///catalogue.db")
    answering.require_catalogue("postgresql:///lightpose?host=/run/postgresql")
    answering.require_scheduler(None)


def test_question_is_asked_before_anything_heavy_is_imported():
    program = f"import sys; import api.cli.archive_commands; print(sorted({HEAVY} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
