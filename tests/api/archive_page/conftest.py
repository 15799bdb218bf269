"""An archive of two sessions, one of another object and time, and a client of the page's server."""

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi.testclient import TestClient

from acquisition.archive.archive import Archive
from acquisition.store.folder import write_manifest
from api.rest import keys
from api.rest.archive_page import server
from api.rest.archive_page.server import ArchivePageSettings
from api.rest.keys import KeyRing
from tests.acquisition.archive import session_copies

OBJECTS = {"20261121-190041-aaaaaa": "Vase, Seite A", "20261121-190041-bbbbbb": "amphora"}


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The archive; the second session has been captured an hour before the first and has no result."""
    folder = tmp_path_factory.mktemp("archive")
    archive = Archive.create(str(folder / "archive"))
    for seed, (name, label) in enumerate(OBJECTS.items()):
        made = session_copies.make(folder / name, seed, label=label, results=seed == 0)
        stated = json.loads((made / "manifest.json").read_text())
        for shot in stated["shots"]:
            shot["taken_at"] -= 3600 * seed
        write_manifest(made, {name: stated[name] for name in ("session_id", "software", "shots")})
        archive.push(made)
    archive.close()
    return str(folder / "archive")


@pytest.fixture
def http(address: str, tmp_path: Path) -> Iterator[httpx.Client]:
    """A client of a server without keys."""
    wanted = ArchivePageSettings(archive=address, data=tmp_path)
    with TestClient(server.create_app(wanted, KeyRing(keys.path_in(tmp_path))), base_url="http://127.0.0.1") as client:
        yield client
