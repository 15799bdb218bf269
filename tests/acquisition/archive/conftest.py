"""Archives of small sessions."""

import os
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from acquisition.archive import catalogue as catalogues
from acquisition.archive.archive import Archive
from tests.acquisition.archive import session_copies


@pytest.fixture
def archive(tmp_path: Path) -> Iterator[Archive]:
    """An empty archive in a folder; its catalogue is SQLite's, or a new database of the server of the environment."""
    opened = Archive.create(str(tmp_path / "archive"), new_database())
    yield opened
    opened.close()


@pytest.fixture
def lose_catalogue() -> Iterator[Callable[[Archive], Archive]]:
    """Opens an archive with an empty catalogue in place of its own."""
    opened: list[Archive] = []

    def reopen(archive: Archive) -> Archive:
        archive.close()
        Path(archive.address, catalogues.FILE).unlink(missing_ok=True)
        opened.append(Archive(archive.address, new_database()))
        return opened[-1]

    yield reopen
    for archive in opened:
        archive.close()


def new_database() -> str | None:
    """Creates a database on the server LIGHTPOSE_TEST_CATALOGUE; None: none is named."""
    server = os.environ.get("LIGHTPOSE_TEST_CATALOGUE")
    if server is None:
        return None
    name = f"test_{uuid.uuid4().hex}"
    engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sa.text(f"CREATE DATABASE {name}"))
    engine.dispose()
    return f"{server.rpartition('/')[0]}/{name}"


@pytest.fixture
def session_folder(tmp_path: Path) -> Callable[..., Path]:
    """Makes a small ended session."""
    return lambda name="20261121-190041-aaaaaa", seed=0, **more: session_copies.make(tmp_path / name, seed, **more)
