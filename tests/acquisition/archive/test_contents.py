"""Content-addressed files: stored once, read back, damage replaced; in folders and in an S3 store over HTTP."""

import fcntl
import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pytest

from acquisition.archive import contents
from acquisition.archive.contents import ContentStore
from acquisition.models.errors import ErrorCode, RigError


@pytest.fixture(scope="module")
def s3_address() -> Iterator[str]:
    """A bucket of a real S3 server on loopback."""
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "key")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        import s3fs

        s3fs.S3FileSystem().mkdir("bucket")
        yield "s3://bucket/archive"
    server.stop()


@pytest.fixture(params=["folder", pytest.param("s3", marks=pytest.mark.long)])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> ContentStore:
    """A store of each kind."""
    if request.param == "folder":
        return ContentStore(str(tmp_path / "store"))
    address: str = request.getfixturevalue("s3_address")
    return ContentStore(f"{address}/{tmp_path.name}")


def put(store: ContentStore, folder: Path, content: bytes) -> tuple[str, bool]:
    file = folder / "file"
    file.write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    return digest, store.put(file, digest)


@pytest.mark.parametrize("size", [0, 1, 9 << 20])
def test_put_get_returns_same_bytes(store: ContentStore, tmp_path: Path, size: int):
    digest, new = put(store, tmp_path, os.urandom(size))
    store.get(digest, tmp_path / "back")
    assert new
    assert (tmp_path / "back").read_bytes() == (tmp_path / "file").read_bytes()


def test_put_known_content_stores_nothing(store: ContentStore, tmp_path: Path):
    digest, _ = put(store, tmp_path, b"calibration")
    assert put(store, tmp_path, b"calibration") == (digest, False)
    assert len(store.names("objects")) == 1


def test_put_damaged_content_is_replaced(store: ContentStore, tmp_path: Path):
    digest, _ = put(store, tmp_path, b"a frame")
    (name,) = store.names("objects")
    store.write(name, b"a frbme")
    assert store.check(digest) == "damaged"
    assert put(store, tmp_path, b"a frame") == (digest, True)
    assert store.check(digest) is None


def test_get_damaged_or_missing_content_is_refused(store: ContentStore, tmp_path: Path):
    digest, _ = put(store, tmp_path, b"a frame")
    (name,) = store.names("objects")
    store.write(name, b"another")
    with pytest.raises(RigError, match="damaged") as damaged:
        store.get(digest, tmp_path / "back")
    store.remove(name)
    with pytest.raises(RigError, match="missing"):
        store.get(digest, tmp_path / "back")
    assert damaged.value.code is ErrorCode.ARCHIVE_DAMAGED
    assert not (tmp_path / "back").exists()


def test_put_file_with_another_hash_is_refused(store: ContentStore, tmp_path: Path):
    (tmp_path / "file").write_bytes(b"changed since")
    with pytest.raises(RigError, match="has changed"):
        store.put(tmp_path / "file", "0" * 64)
    assert store.names("objects") == []


def test_named_file_is_replaced_as_a_whole(store: ContentStore):
    assert store.read("archive.json") is None
    store.write("archive.json", b"1")
    store.write("archive.json", b"22")
    assert store.read("archive.json") == b"22"
    assert store.names("") == ["archive.json"]


def test_files_of_killed_pushes_are_removed_and_of_running_ones_kept(tmp_path: Path):
    store = ContentStore(str(tmp_path / "store"))
    begin = (
        "import os, sys; from pathlib import Path; from acquisition.archive import contents\n"
        "with contents._renamed(Path(sys.argv[1]), 'objects/00/a') as partial:\n"
        "    partial.write_bytes(b'half'); print('begun', flush=True); sys.stdin.read(); os.kill(os.getpid(), 9)"
    )
    command = [sys.executable, "-c", begin, str(tmp_path / "store")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"begun\n"
        put(store, tmp_path, b"meanwhile")
        (left,) = (tmp_path / "store" / contents.PARTIALS).iterdir()
        assert left.read_bytes() == b"half"
        running.communicate()
    assert left.exists()
    put(store, tmp_path, b"afterwards")
    assert list((tmp_path / "store" / contents.PARTIALS).iterdir()) == []
    assert len(store.names("")) == 2


def test_file_that_another_push_removed_before_its_lock_is_begun_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file is open for a moment before it is locked, and looks like one of a killed push meanwhile."""
    removed, flock = list[str](), fcntl.flock

    def late(file: BinaryIO, operation: int) -> None:
        if not removed and operation == fcntl.LOCK_EX:
            removed.append(file.name)
            Path(file.name).unlink()
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", late)
    with contents._renamed(tmp_path, "objects/00/a") as partial:
        assert len(removed) == 1
        assert str(partial) not in removed
        with partial.open("r+b") as other, pytest.raises(BlockingIOError):
            flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        partial.write_bytes(b"whole")
    assert (tmp_path / "objects" / "00" / "a").read_bytes() == b"whole"


def test_unknown_scheme_is_refused():
    with pytest.raises(RigError) as refused:
        ContentStore("nothing://there")
    assert refused.value.code is ErrorCode.ARCHIVE_ADDRESS_INVALID


@pytest.mark.long
def test_store_that_does_not_answer_is_named(s3_address: str, monkeypatch: pytest.MonkeyPatch):
    import s3fs

    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(RigError, match="s3://elsewhere") as refused:
        ContentStore("s3://elsewhere/archive").read("archive.json")
    s3fs.S3FileSystem.clear_instance_cache()
    assert refused.value.code is ErrorCode.ARCHIVE_UNREACHABLE


def test_folder_without_rights_is_named(tmp_path: Path):
    (tmp_path / "file").write_text("a file where a folder should be")
    with pytest.raises(RigError) as refused:
        ContentStore(str(tmp_path / "file" / "archive")).write("archive.json", b"")
    assert refused.value.code is ErrorCode.ARCHIVE_UNREACHABLE
