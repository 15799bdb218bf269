"""What a person brings along: figures typed digit by digit, long lists, long words, mistyped addresses, old keys."""

import time
from collections.abc import Callable

import httpx
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from api.rest import keys
from api.rest.keys import Role
from api.rest.schemas import Problem
from tests.api.page import chromium
from tests.api.page.chromium import Console, until
from tests.api.page.conftest import HANGING_S, Lab

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]

PAGE = 50
"""Sessions that the list shows at first."""

PULSE_ENDED_MS = 2_500
"""Time after which a pulse that is not answered has been given up, ms."""

HEIGHT = 700
"""Of a small window, px."""

KNOWN_WITHIN_S = 60.0
"""Time in which the service reads a key that was added, s."""


def test_page_keeps_decimal_point_while_it_is_typed(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/start")
    page.locator("label.preset", has_text="Target accuracy").click()
    field = page.locator("#recipe-target_sigma_deg")
    expect(field).to_have_value("0.7")
    field.press("End")
    field.press("Backspace")
    field.press("5")
    expect(field).to_have_value("0.5")
    page.locator("label.preset").first.click()
    page.locator("label.preset", has_text="Target accuracy").click()
    expect(field).to_have_value("0.7")  # a preset writes it again


def test_page_list_stays_as_long_as_it_was_made(opened: Callable[..., Page], lab: Lab) -> None:
    for number in range(PAGE + 5):
        lab.client.create(Recipe(label=f"of many {number}"))
    page = opened(Role.OPERATOR, "#/sessions")
    page.get_by_label("Search").fill("of many")
    rows = page.locator("tr[data-session]")
    expect(rows).to_have_count(PAGE)
    page.get_by_role("button", name="Show more").click()
    expect(rows).to_have_count(PAGE + 5)
    made = lab.client.create(Recipe(label="of many, the last"))
    expect(page.get_by_role("link", name="of many, the last")).to_be_visible()
    expect(rows).to_have_count(PAGE + 5)  # the oldest is a page further
    until(page, f"window.lightpose.events.some((event) => event.session_id === '{made.id}')")
    page.get_by_label("Search").fill("of many 1")
    expect(rows).to_have_count(11)


@pytest.mark.parametrize("width", [360, 1280])
def test_page_long_words_stay_in_window_and_off_stop(opened: Callable[..., Page], lab: Lab, width: int) -> None:
    session_id = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="W" * 200, notes="first\n" + "n" * 400))
    page = opened(Role.OPERATOR, f"#/sessions/{session_id}")
    page.set_viewport_size({"width": width, "height": HEIGHT})
    expect(page.locator("#rig-state")).to_contain_text("WWW")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator("#rig-state").evaluate("(words) => words.scrollWidth <= words.clientWidth")
    assert "first\n" in page.locator(".notes").inner_text()
    box = page.locator("app-bar").bounding_box()
    assert box is not None
    assert box["height"] < HEIGHT / 2


def test_page_works_at_mistyped_address(context: BrowserContext, console: Console, lab: Lab) -> None:
    page = chromium.open_page(context, console, f"{lab.url}/#/sessions/%E0%A4%A", lab.secrets[Role.VIEWER])
    expect(page.locator("main")).to_contain_text("There is no such session")


def admitted(lab: Lab, name: str) -> str:
    """A new operator's key that the service knows already."""
    secret = keys.add(keys.path_in(lab.service.data), name, Role.OPERATOR)
    deadline = time.monotonic() + KNOWN_WITHIN_S
    while not caller(lab, secret).is_success:
        assert time.monotonic() < deadline
        time.sleep(0.5)
    return secret


def caller(lab: Lab, secret: str) -> httpx.Response:
    """The service's answer to who a key's holder is."""
    return httpx.get(f"{lab.url}/v1/caller", headers={"Authorization": f"Bearer {secret}"})


def test_page_answer_about_old_key_does_not_end_new_one(context: BrowserContext, console: Console, lab: Lab) -> None:
    """Each tab has an event stream of its own where shared workers are missing, as in many browsers of tablets."""
    context.add_init_script("delete window.SharedWorker")
    page = chromium.open_page(context, console, f"{lab.url}/#/rig", admitted(lab, "leaver"))
    keys.revoke(keys.path_in(lab.service.data), "leaver")
    until(page, "lightpose.keyNeeded && lightpose.stream.refused === 401")
    with page.expect_request("**/health/live"):
        page.route("**/health/live", lambda route: None)  # this pulse is answered after the new key is in use
    key = page.get_by_label("Key", exact=True)
    key.fill(lab.secrets[Role.OPERATOR])
    page.get_by_role("button", name="Sign in").click()
    expect(key).to_have_count(0)
    page.unroute_all()
    page.wait_for_timeout(PULSE_ENDED_MS)
    expect(key).to_have_count(0)
    until(page, "lightpose.stream.open")


def test_page_of_revoked_key_asks_for_another_on_crowded_machine(opened: Callable[..., Page], lab: Lab) -> None:
    """After many wrong keys of a machine one more is refused as such; a valid one never is."""
    page = opened(Role.OPERATOR, "#/rig")
    refusal = Problem.of(ErrorCode.REQUEST_TOO_MANY_FAILURES, "10 requests without a valid key")
    page.route("**/v1/rig", lambda route: route.fulfill(status=429, body=refusal.model_dump_json()))
    expect(page.get_by_label("Key", exact=True)).to_be_visible()
