"""What the page says while the service is not there or cannot be read, and what it does when it is back."""

import re
from collections.abc import Callable, Generator

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from api.rest.keys import Role
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.conftest import HANGING_S, Lab
from tests.api.page.weak_network import BAD_GATEWAY, WeakNetwork, target_of

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
PROXY = "127.0.49.5"


@pytest.fixture
def network(lab: Lab) -> Generator[WeakNetwork]:
    """A proxy before the lab's service."""
    with WeakNetwork(PROXY, target_of(lab.url)) as made:
        yield made


def test_page_stop_pressed_again_goes_on_counting(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork
) -> None:
    """Whoever presses twice a second reads all the same that it is not heard."""
    page = chromium.open_page(context, console, f"{network.url}/#/rig", lab.secrets[Role.VIEWER])
    network.cut()
    for _ in range(8):
        page.keyboard.press("Escape")
        page.wait_for_timeout(400)
    expect(page.locator("#stop-told")).to_have_text(re.compile(r"STOP NOT HEARD for [3-9] s \((\d\d) attempts\)"))
    network.restore()
    page.locator("#stop-told.heard").wait_for()
    assert not lab.client.safety().clear


def test_page_behind_proxy_of_dead_service_is_not_connected(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork
) -> None:
    page = chromium.open_page(context, console, f"{network.url}/#/sessions", lab.secrets[Role.OPERATOR])
    expect(page.locator("#arm-motion")).to_have_text("ARM AT REST")
    network.answer = BAD_GATEWAY
    network.cut()
    page.locator("#connection[data-open=false]").wait_for()
    page.locator("#connection[data-stale=true]").wait_for()
    expect(page.locator("#arm-motion")).to_have_text("ARM: NOT KNOWN")
    page.get_by_label("Search").fill("nothing of this name")
    expect(page.locator("sessions-screen [role=alert]")).to_be_visible()
    expect(page.locator("main")).not_to_contain_text("No session")
    network.restore()
    page.locator("#connection[data-stale=false]").wait_for()
    expect(page.locator("main")).to_contain_text("No session matches the search")  # without a reload


def test_page_says_that_rig_could_not_be_read(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    expect(page.locator("#park")).to_be_enabled()
    page.route("**/v1/rig", lambda route: route.abort())
    expect(page.locator("#stale-notice")).to_contain_text("the state of the rig could not be read since")
    expect(page.locator("#park")).to_be_disabled()
    page.unroute("**/v1/rig")
    expect(page.locator("#park")).to_be_enabled()


def test_page_keeps_key_that_could_not_be_tried(
    context: BrowserContext, console: Console, lab: Lab, network: WeakNetwork
) -> None:
    page = console.watch(context.new_page())
    page.goto(network.url)
    page.get_by_label("Key", exact=True).fill(lab.secrets[Role.VIEWER])
    network.cut()
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator("sign-in [role=alert]")).to_contain_text("the key has not been checked yet")
    network.restore()
    expect(page.locator("#connection")).to_contain_text("viewer")
