"""A simulated cell, the service as a process of its own with keys, and Chromium; skipped by name without Chromium."""

import contextlib
import os
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import numpy.typing as npt
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session import SAME_JOINTS_RAD
from acquisition.session_state import State
from api import Client
from api.client.responses import ProblemError
from api.rest import keys
from api.rest.keys import Role
from api.rest.schemas import Problem
from hardware_sim.cell import Cell, CellOptions
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.end_to_end.processes import Service, serving

CELL = f"127.0.49.{100 + int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))}"
"""One for each process that runs tests, since modules share it."""

TIMEOUT_MS = 120_000
"""How long the page is waited for, ms: what hangs fails, what a busy machine delays does not."""

COMPUTED_WITHIN_MS = 1_200_000
"""How long is waited for what is computed or moved first: a cell's reach, a dry run, a pass of a session, ms. A machine
with seven times the work that it can do takes six minutes for the reach of the simulated cell."""

HANGING_S = 3_000
"""After which a long test counts as hanging, s."""

SETTLE_ATTEMPTS = 5
PARKED_WITHIN_S = 120.0
"""Times that the rig is made ready, and time for the way home, s; a busy machine stops the arm on its way."""

CELL_FILE = Path(__file__).parents[2] / "data" / "cell.test.toml"


@dataclass(frozen=True)
class Lab:
    """A cell and its service; `secrets` are the keys by role."""

    cell: Cell
    service: Service
    client: Client
    secrets: dict[Role, str]

    @property
    def url(self) -> str:
        """The service's address."""
        return self.service.url

    def resume_if_interrupted(self, session_id: str) -> None:
        """Resumes a session that the controller's watchdog has interrupted, as a busy machine makes it do."""
        if self.client.session(session_id).state is State.INTERRUPTED:
            if not self.client.safety().clear:
                self.client.acknowledge()
            with contextlib.suppress(ProblemError):  # the devices are being connected again
                self.client.resume(session_id)

    def start(self, recipe: Recipe) -> str:
        """Starts a session and returns its id."""
        for _ in range(SETTLE_ATTEMPTS):
            session_id = str(self.client.create(recipe).id)
            try:
                self.client.start(session_id)
            except ProblemError:  # a busy machine has made the watchdog stop the arm since it was made ready
                self.settle()
                continue
            return session_id
        raise AssertionError("no session starts")

    def settle(self) -> None:
        """Ends what holds the rig, acknowledges, and brings the arm home, so that the next test finds a free rig."""
        refusals: list[str] = []
        for _ in range(SETTLE_ATTEMPTS):
            holder = self.client.rig().holder
            if holder is not None:
                self.client.stop(holder)
                self.client.wait(holder)
            if not self.client.safety().clear:
                self.client.acknowledge()
            try:
                self.client.wait_ready(60)
                self._go_home()
            except ProblemError as error:  # a busy machine has made the watchdog stop the arm again
                refusals.append(str(error))
                continue
            return
        raise AssertionError(f"the rig does not come to rest: {refusals}")

    def _go_home(self) -> None:
        home = np.array(self.client.scene().arm.home)
        if np.abs(self.joints() - home).max() < SAME_JOINTS_RAD:
            return
        self.client.park()
        deadline = time.monotonic() + PARKED_WITHIN_S
        while not np.abs(self.joints() - home).max() < SAME_JOINTS_RAD:
            if time.monotonic() > deadline:
                raise ProblemError(Problem.of(ErrorCode.ARM_MOVE_FAILED, "The arm has not come home"))
            time.sleep(0.05)

    def joints(self) -> npt.NDArray[np.float64]:
        """The arm's joints, rad; not numbers while the service has no reading of it."""
        reading = self.client.rig().reading
        return np.array(reading.joints) if reading is not None else np.full(6, np.nan)

    def get(self, address: str) -> httpx.Response:
        """An answer of the service to an admin."""
        authorization = {"Authorization": f"Bearer {self.secrets[Role.ADMIN]}"}
        return httpx.get(self.url + address, headers=authorization, timeout=COMPUTED_WITHIN_MS / 1e3)


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    """One Chromium for a module's tests; each gets a context of its own.

    Not for the whole session: until playwright is stopped its event loop counts as running in this thread, where the
    next module's tests then could not run one of their own.
    """
    if chromium.EXECUTABLE is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as playwright:
        running = chromium.launch(playwright)
        yield running
        running.close()


@pytest.fixture
def console() -> Generator[Console]:
    """What the pages of a test complain of; it fails when they do."""
    made = Console()
    yield made
    assert made.errors == []


@pytest.fixture
def context(browser: Browser) -> Generator[BrowserContext]:
    """A browser context: its own storage, workers and downloads."""
    made = browser.new_context(viewport={"width": 1280, "height": 860}, locale="en-GB")
    made.set_default_timeout(TIMEOUT_MS)
    yield made
    made.close()


def make_lab(
    folder: Path, speed: float, pixels: int = 128, address: str = CELL, profile: str = "direct"
) -> Generator[Lab]:
    """A cell whose arm moves at `speed` times real time, and a service with a key for each role."""
    data = folder / "data"
    data.mkdir()
    secrets = {role: keys.add(keys.path_in(data), str(role), role) for role in Role}
    options = CellOptions(address, "figure", 1, profile, speed, pixels=pixels, cell_file=CELL_FILE)
    with (
        Cell(options, folder / "cell") as cell,
        serving(cell, data) as service,
        Client(service.url, key=secrets[Role.ADMIN]) as client,
    ):
        lab = Lab(cell, service, client, secrets)
        lab.settle()
        yield lab


@pytest.fixture(scope="module")
def lab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    """A cell at five times real time for the tests of a module."""
    yield from make_lab(tmp_path_factory.mktemp("lab"), speed=5.0)


@pytest.fixture(autouse=True)
def settled(request: pytest.FixtureRequest) -> Generator[None]:
    """Leaves the lab's rig free, acknowledged and at home, unless the test has killed its service."""
    lab = request.getfixturevalue("lab") if "lab" in request.fixturenames else None
    if lab is not None and lab.service.process.poll() is None:
        lab.settle()
    yield
    if lab is not None and lab.service.process.poll() is None:
        lab.settle()


@pytest.fixture
def opened(context: BrowserContext, console: Console, lab: Lab) -> Callable[..., Page]:
    """`opened(role, "#/cell")` is a page of the lab's service, signed in."""

    def open_as(role: Role = Role.ADMIN, place: str = "") -> Page:
        return chromium.open_page(context, console, f"{lab.url}/{place}", lab.secrets[role])

    return open_as
