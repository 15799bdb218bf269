"""Two pages of one browser, and a viewer's page beside an operator's."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from api.rest import keys
from api.rest.keys import Role
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.conftest import HANGING_S, Lab

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]

CHANGING = ("Start", "Save", "Accept", "Acknowledge", "Bring the arm home", "Delete", "Pause", "Resume", "End")
"""Beginnings of the names of buttons that change something."""
SCREENS = ("#/start", "#/cell", "#/preview", "#/sessions", "#/queue", "#/rig", "#/calibration")


def test_page_of_viewer_offers_nothing_that_changes(
    browser: Browser, opened: Callable[..., Page], console: Console, lab: Lab
) -> None:
    operator = opened(Role.OPERATOR, "#/start")
    operator.get_by_label("Label").fill("seen by two")
    operator.get_by_role("button", name="Save without starting").click()
    operator.locator("[data-action=start]").wait_for()
    session = next(iter(lab.client.sessions()))
    other = browser.new_context(locale="en-GB")
    viewer = chromium.open_page(other, console, f"{lab.url}/", lab.secrets[Role.VIEWER])
    expect(viewer.locator("#connection")).to_contain_text("viewer")
    for place in (*SCREENS, f"#/sessions/{session.id}", f"#/sessions/{session.id}/plan"):
        viewer.goto(f"{lab.url}/{place}")
        expect(viewer.locator("main h1")).to_be_visible()
        for name in CHANGING:
            expect(viewer.locator("main").get_by_role("button", name=name)).to_have_count(
                1 if name == "Save" and place == "#/cell" else 0  # the picture of the cell
            )
        expect(viewer.locator("#stop")).to_be_enabled()
    viewer.goto(f"{lab.url}/#/rig")
    expect(viewer.locator("#values")).to_be_visible()
    expect(viewer.locator("key-list")).to_have_count(0)
    viewer.goto(f"{lab.url}/#/sessions/{session.id}")
    expect(viewer.locator("h1")).to_have_text("seen by two")
    other.close()


def test_page_twice_in_one_browser_shares_event_stream(
    context: BrowserContext, console: Console, opened: Callable[..., Page], lab: Lab
) -> None:
    first = opened(Role.OPERATOR, "#/sessions")
    second = chromium.open_page(context, console, f"{lab.url}/#/sessions", lab.secrets[Role.OPERATOR])
    first.goto(f"{lab.url}/#/start")
    first.get_by_label("Label").fill("made in the first page")
    first.get_by_role("button", name="Save without starting").click()
    expect(second.get_by_role("link", name="made in the first page")).to_be_visible()
    metrics = lab.get("/metrics").text
    listeners = [line for line in metrics.splitlines() if line.startswith("lightpose_event_listeners")]
    assert [float(line.split()[-1]) for line in listeners] == [1.0]


def test_page_refuses_wrong_key_in_words(context: BrowserContext, console: Console, lab: Lab) -> None:
    page = console.watch(context.new_page())
    page.goto(f"{lab.url}/")
    page.get_by_label("Key", exact=True).fill("lightpose_wrong")
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("alert").filter(has_text="does not know this key")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#stop-told")).to_contain_text("The service refused the key")
    page.get_by_label("Key", exact=True).fill(lab.secrets[Role.VIEWER])
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator("#connection")).to_contain_text("viewer")
    page.get_by_role("button", name="Sign out").click()
    expect(page.get_by_label("Key", exact=True)).to_be_visible()


def test_page_of_revoked_key_asks_for_another(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    keys.revoke(keys.path_in(lab.service.data), str(Role.OPERATOR))
    expect(page.get_by_label("Key", exact=True)).to_be_visible()
    expect(page.locator("#stop")).to_be_enabled()
