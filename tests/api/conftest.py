"""A real service on a loopback address: journal, runner, server and client; at the arm's address nobody listens."""

import logging
import re
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client
from api.rest import keys, server, settings
from api.rest.server import Server
from api.rest.settings import Settings
from api.rest.wiring import Service
from hardware_sim.cell import Cell, CellOptions

REPOSITORY = Path(__file__).parents[2]
CELL_FILE = REPOSITORY / "tests" / "data" / "cell.test.toml"
NOBODY = "127.0.4.1"
SERVICE = "127.0.4.2"
MOST_STOPS = 8


@dataclass(frozen=True)
class Running:
    """A service that runs in this process."""

    url: str
    server: Server
    service: Service
    client: Client
    http: httpx.Client
    settings: Settings
    thread: threading.Thread
    key: str | None


def write_cell(folder: Path, address: str) -> Path:
    """The simulated cell's file with arm and camera at `address`."""
    folder.mkdir(parents=True, exist_ok=True)
    text = (REPOSITORY / "hardware_sim" / "cells" / "cell.sim.toml").read_text(encoding="utf-8")
    path = folder / "cell.toml"
    path.write_text(re.sub(r'^address = ".*"', f'address = "{address}"', text, flags=re.MULTILINE), encoding="utf-8")
    calibration = REPOSITORY / "hardware_sim" / "cells" / "calibration.sim.json"
    (folder / calibration.name).write_bytes(calibration.read_bytes())
    return path


@contextmanager
def serve(chosen: Settings, key: str | None = None) -> Generator[Running]:
    """Runs a service in a thread of this process; its client sends `key`."""
    listening = threading.Event()
    said: list[str] = []

    def say(url: str) -> None:
        said.append(url)
        listening.set()

    made = server.create(chosen, say)
    thread = threading.Thread(target=made.run)
    thread.start()
    try:
        assert listening.wait(60)
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        with Client(said[0], key) as client, httpx.Client(base_url=said[0], timeout=60, headers=headers) as http:
            yield Running(said[0], made, made.service, client, http, chosen, thread, key)
    finally:
        made.should_exit = True
        thread.join(60)
        assert not thread.is_alive()


def running(
    folder: Path, address: str = NOBODY, port: int = 0, key: str | None = None, **more: object
) -> AbstractContextManager[Running]:
    """Runs a service for a cell at `address`, with its data in `folder`/data."""
    cell = write_cell(folder, address)
    return serve(settings.read(cell=cell, data=folder / "data", host=SERVICE, port=port, **more), key)


@contextmanager
def at_simulated_cell(folder: Path, address: str, pixels: int) -> Generator[Running]:
    """Runs a service at a simulated cell of its own, once it is ready."""
    options = CellOptions(address, "sphere", 1, "ideal", 20, pixels=pixels, cell_file=CELL_FILE)
    with (
        Cell(options, folder / "cell") as cell,
        serve(settings.read(cell=cell.cell_file, data=folder / "data", host=SERVICE, port=0)) as service,
    ):
        service.client.wait_ready()
        yield service


def plan_under_review(client: Client, recipe: Recipe) -> str:
    """A session whose plan waits for review; resumed where the watchdog stops the arm on a busy machine."""
    session = client.create(recipe)
    client.start(session.id)
    for _ in range(MOST_STOPS):
        resource = client.wait(session.id)
        if resource.state is not State.INTERRUPTED:
            break
        client.resume(session.id)
    assert resource.reason is not None
    assert resource.reason.code is ErrorCode.PLAN_TO_REVIEW
    return session.id


@pytest.fixture(scope="session")
def serving() -> Callable[..., AbstractContextManager[Running]]:
    """`serving(settings, key)` is a context manager that runs a service."""
    return serve


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Generator[Running]:
    """One service for the tests of a module that leave it as it was."""
    with running(tmp_path_factory.mktemp("service")) as service:
        yield service


@pytest.fixture
def own(tmp_path: Path) -> Generator[Running]:
    """A service for one test."""
    with running(tmp_path) as service:
        yield service


@pytest.fixture
def administered(tmp_path: Path) -> Generator[Running]:
    """A service for one test, whose client holds an admin's key."""
    secret = keys.add(keys.path_in(tmp_path / "data"), "an-admin", keys.Role.ADMIN)
    with running(tmp_path, key=secret) as service:
        yield service


@pytest.fixture
def start(tmp_path: Path) -> Callable[..., AbstractContextManager[Running]]:
    """`start(address=…, port=…)` is a context manager that runs a service; the data folder stays the same."""

    return partial(running, tmp_path)


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    """A cell file whose devices do not answer."""
    return write_cell(tmp_path / "cell", NOBODY)


@pytest.fixture(autouse=True)
def root_as_before() -> Generator[None]:
    """A service that logs replaces the handlers of the root logger."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level
