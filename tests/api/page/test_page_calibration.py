"""The calibration screen: a hand-eye calibration by clicks to its activation; and without findings of axe-core."""

import re
from collections.abc import Callable, Generator

import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from api.rest.keys import Role
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab, make_lab
from tests.api.page.pictures import contrast, pixels
from tests.api.page.test_page_access import assert_accessible

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
ADDRESS = "127.0.49.12"
PIXELS = 512
GREEN = (78, 240, 138)
"""Colour of the marks on corners that are found."""

PROFILE = "realistic"
"""The simulated cell with a lit room: the board is lit by it."""


@pytest.fixture(scope="module")
def board_lab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    """A cell with a board on the flange; nobody has said so to the service."""
    folder = tmp_path_factory.mktemp("board")
    for lab in make_lab(folder, speed=5.0, pixels=PIXELS, address=ADDRESS, profile=PROFILE):
        lab.cell.place("charuco@flange")
        yield lab


@pytest.fixture
def wizard(context: BrowserContext, console: Console, board_lab: Lab) -> Callable[[Role], Page]:
    """`wizard(role)` is the calibration's screen with the kind `hand-eye` chosen."""

    def open_as(role: Role) -> Page:
        page = chromium.open_page(context, console, f"{board_lab.url}/#/calibration", board_lab.secrets[role])
        page.locator("#kinds input[value='hand-eye']").check()
        page.locator("#tool").wait_for()
        return page

    return open_as


def marks(page: Page) -> float:
    """Share of the live image's pixels that have the colour of a found corner."""
    picture = pixels(page.locator("target-preview canvas")).astype(float)
    return float(np.mean(np.abs(picture[..., :3][..., ::-1] - GREEN).max(axis=2) < 40))


def resume_until(page: Page, states: str) -> None:
    """Waits for one of the states; on a busy machine the watchdog interrupts the session, and a person resumes."""
    for _ in range(20):
        wanted = ", ".join(f"#session-state[data-state={state}]" for state in (*states.split(), "interrupted"))
        page.locator(wanted).wait_for(timeout=COMPUTED_WITHIN_MS)
        if page.locator("#session-state").get_attribute("data-state") != "interrupted":
            return
        page.locator("[data-action=resume]").click()
        page.locator("[data-confirm=resume]").click()
        page.locator("#session-state:not([data-state=interrupted])").wait_for()
    raise AssertionError(f"the session does not become {states}")


def test_page_hand_eye_by_clicks_is_activated(wizard: Callable[[Role], Page], board_lab: Lab) -> None:
    client = board_lab.client
    before = client.calibration()
    page = wizard(Role.OPERATOR)
    expect(page.locator("#kinds label", has_text="Camera and its place")).to_contain_text("Not calibrated here yet")
    expect(page.locator("#start-calibration")).to_be_disabled()  # the lamp is stated, the board needed
    page.locator("tool-statement button[data-tool=board]").click()
    page.get_by_role("button", name="Yes, it is").click()
    expect(page.locator("#tool")).to_have_attribute("data-tool", "board")
    assert client.rig().tool == "board"
    page.get_by_label("Maximum number of images").fill("12")
    page.get_by_label("Target accuracy: place of the camera").fill("0.05")
    page.locator("#start-calibration").click()
    page.locator("svg.view polygon").wait_for(timeout=COMPUTED_WITHIN_MS)
    assert contrast(page.locator("svg.view")) > 20
    page.locator("#target-found[data-seen=true]").wait_for(timeout=COMPUTED_WITHIN_MS)
    expect(page.locator("#target-found")).to_contain_text("48")
    assert marks(page) > 0.002
    page.locator("[data-view]").nth(7).wait_for(timeout=COMPUTED_WITHIN_MS)  # residuals of the first pass
    resume_until(page, "completed")
    session = next(iter(client.sessions()))
    found = session.estimate
    assert found is not None
    assert found.position_sigma_mm is not None
    expect(page.locator("[data-view]")).to_have_count(12)
    expect(page.locator("[data-figure=position_sigma_mm]")).to_have_text(f"{found.position_sigma_mm:.2f} (target 0.05)")
    expect(page.locator("#reached")).to_contain_text("is not reached")
    assert client.calibration().id == "cell"  # not by itself
    page.locator(f"[data-calibration='{session.id}']").get_by_role("button", name="Use it").click()
    page.locator("#activate").click()
    expect(page.locator(f"[data-calibration='{session.id}']")).to_contain_text("in use")
    after = client.calibration()
    assert after.id == session.id
    assert after.fingerprint != before.fingerprint
    page.get_by_role("button", name="Now it is the lamp").click()
    page.get_by_role("button", name="Yes, it is").click()
    expect(page.locator("#tool")).to_have_attribute("data-tool", "lamp")
    assert_accessible(page, "a completed calibration")

    # The list: the kind has an age now, and the way back is an earlier calibration.
    page.goto(f"{board_lab.url}/#/calibration")
    expect(page.locator("#kinds label", has_text="Camera and its place")).to_contain_text("Last 0.0 days ago")
    page.locator("[data-calibration=cell]").get_by_role("button", name="Use it").click()
    page.locator("#activate").click()
    expect(page.locator(".fingerprint")).to_have_text(before.fingerprint)
    page.goto(f"{board_lab.url}/#/sessions/{session.id}/images")
    expect(page.locator("#image-count")).to_have_text("12")
    expect(page.locator(".images figcaption", has_text="View 8")).to_have_count(1)
    expect(page.locator(".images figcaption", has_text="Light")).to_have_count(0)
    expect(page.locator(".stages")).to_contain_text("planning views")


def test_page_wizard_is_accessible_narrow_and_worked_by_keys(wizard: Callable[[Role], Page], board_lab: Lab) -> None:
    page = wizard(Role.ADMIN)
    page.locator("#target-found:not(:has-text('…'))").wait_for()
    assert_accessible(page, "wizard")
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    page.locator("#kinds input[value='hand-eye']").focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator("#kinds input[value='camera']")).to_be_checked()
    expect(page.get_by_label("place of the camera, 1 σ, mm")).to_have_count(0)  # a camera alone has no place to find
    for _ in range(30):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement?.dataset.tool") == "board":
            break
    page.keyboard.press("Enter")
    page.locator("#state-tool").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#tool")).to_have_attribute("data-tool", "board")
    board_lab.client.state_tool("lamp")


def test_page_wizard_shows_first_views_before_anything_moves(wizard: Callable[[Role], Page], board_lab: Lab) -> None:
    page, before = wizard(Role.OPERATOR), board_lab.joints()
    page.locator("#show-views").click()
    page.locator("first-views svg polygon").nth(7).wait_for(timeout=COMPUTED_WITHIN_MS)
    assert contrast(page.locator("first-views svg")) > 5
    expect(page.locator("first-views svg")).to_have_attribute("aria-label", re.compile(r"View 8: \d+ mm away"))
    assert np.abs(board_lab.joints() - before).max() < 1e-3
    page.get_by_label("Maximum number of images").fill("30")
    expect(page.locator("first-views svg")).to_have_count(0)  # other views may be planned for it
    expect(page.locator("#show-views")).to_be_enabled()


def test_page_viewer_sees_calibration_and_changes_nothing(wizard: Callable[[Role], Page]) -> None:
    page = wizard(Role.VIEWER)
    page.locator("[data-calibration=cell]").wait_for()
    expect(page.locator("calibration-screen").get_by_role("button")).to_have_count(0)
