"""The page over a network that breaks and a service that dies: it says so, STOP still tries, and nothing is lost."""

from collections.abc import Generator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from acquisition.models.recipe import Recipe
from api.rest.keys import Role
from tests.api.page import chromium
from tests.api.page.chromium import Console, until
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab, make_lab
from tests.api.page.weak_network import WeakNetwork, target_of
from tests.end_to_end.processes import serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
PROXY = "127.0.49.3"
CUT_MS = 10_000
BYTES_PER_S = 60_000.0
"""Of the throttled network: a poor radio link."""


@pytest.fixture(scope="module")
def lab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    """A cell of its own: its service is killed."""
    yield from make_lab(tmp_path_factory.mktemp("lab"), speed=5.0)


@pytest.fixture
def network(lab: Lab) -> Generator[WeakNetwork]:
    """A proxy before the lab's service."""
    with WeakNetwork(PROXY, target_of(lab.url)) as made:
        yield made


def heard(page: Page) -> set[int]:
    """Ids of the events that the page has received."""
    return set(page.evaluate("window.lightpose.events.map((event) => event.id)"))


def test_page_cut_off_says_so_and_catches_up(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork
) -> None:
    page = chromium.open_page(context, console, f"{network.url}/#/start", lab.secrets[Role.OPERATOR])
    expect(page.locator("#connection")).to_contain_text("Connected")
    first = lab.client.create(Recipe(label="before the cut"))
    page.evaluate("window.opened = true")  # gone after a reload
    until(page, f"window.lightpose.events.some((event) => event.session_id === '{first.id}')")

    network.cut()
    made = [lab.client.create(Recipe(label=f"during the cut {number}")).id for number in range(5)]
    page.locator("#connection[data-stale=true]").wait_for()
    expect(page.locator("#stale-notice")).to_contain_text("No connection since")
    page.keyboard.press("Escape")
    page.locator("#stop-told.unheard").wait_for()
    expect(page.locator("#stop-told")).to_contain_text("STOP NOT HEARD")
    page.wait_for_timeout(CUT_MS)
    network.restore()

    page.locator("#stop-told.heard").wait_for()
    page.locator("#connection[data-stale=false]").wait_for()
    for identity in made:
        until(page, f"window.lightpose.events.some((event) => event.session_id === '{identity}')")
    assert page.evaluate("window.opened") is True
    journal = {event.id for session in [first.id, *made] for event in lab.client.past_events(session)}
    assert journal <= heard(page)


def test_page_on_throttled_network_is_usable_and_stops(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork
) -> None:
    network.bytes_per_s = BYTES_PER_S
    page = chromium.open_page(context, console, f"{network.url}/#/preview", lab.secrets[Role.OPERATOR])
    page.get_by_role("link", name="Cell").click()  # half a megabyte, under way when STOP is pressed
    page.keyboard.press("Escape")
    page.locator("#stop-told.heard").wait_for()
    page.locator("#cell[data-frames]").wait_for(timeout=COMPUTED_WITHIN_MS)


def test_page_survives_service_that_is_killed(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork, tmp_path: Path
) -> None:
    page = chromium.open_page(context, console, f"{network.url}/#/start", lab.secrets[Role.OPERATOR])
    session_id = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="its service dies"))
    page.goto(f"{network.url}/#/sessions/{session_id}")
    page.locator("#session-state[data-state=running]").wait_for()
    until(page, "window.lightpose.events.some((event) => event.type === 'arm.sent')")
    lab.service.kill()
    page.locator("#connection[data-stale=true]").wait_for()
    with serving(lab.cell, lab.service.data) as again:
        network.target = target_of(again.url)
        page.locator("#connection[data-stale=false]").wait_for()
        page.locator("#session-state[data-state=interrupted]").wait_for()
        expect(page.locator("#session-reason")).to_contain_text("The service ended during the session")
        expect(page.locator("[data-action=resume]")).to_be_visible()
