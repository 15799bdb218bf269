"""Every screen without a finding of axe-core, in both languages, light and dark, 360 px wide; and by keyboard alone."""

from collections.abc import Callable

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from api.rest.keys import Role
from tests.api.page.conftest import Lab

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]
SCREENS = ("start", "session", "cell", "preview", "sessions", "queue", "rig", "calibration")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_screens_have_no_finding_of_axe(opened: Callable[..., Page], lab: Lab, scheme: str) -> None:
    page = opened(Role.ADMIN)
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    axe = Axe()
    for language in ("Deutsch", "English"):
        page.get_by_role("button", name=language).click()
        for screen in SCREENS:
            page.goto(f"{lab.url}/#/{screen}")
            expect(page.locator("main h1")).to_be_visible()
            page.wait_for_timeout(300)
            found = axe.run(page)
            assert found.violations_count == 0, (screen, language, found.generate_report())


def test_page_fits_into_360_px(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.ADMIN)
    page.set_viewport_size({"width": 360, "height": 740})
    for screen in SCREENS:
        page.goto(f"{lab.url}/#/{screen}")
        expect(page.locator("main h1")).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, screen
        box = page.locator("#stop").bounding_box()
        assert box is not None
        assert box["x"] + box["width"] <= 360
        assert box["height"] >= 48


def test_page_session_is_saved_by_keyboard_alone(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/start")
    page.get_by_label("Label").wait_for()
    page.keyboard.press("Tab")
    for _ in range(60):
        if page.evaluate("document.activeElement?.id") == "recipe-label":
            break
        page.keyboard.press("Tab")
    page.keyboard.type("typed only")
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement?.value") == "create":
            break
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("typed only")
