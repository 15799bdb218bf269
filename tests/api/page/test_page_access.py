"""Every screen without a finding of axe-core, in both languages, light and dark, 360 px wide; and by keyboard alone."""

from collections.abc import Callable

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import BrowserContext, Page, expect

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api.rest.keys import Role
from tests.api.page.chromium import Console, until
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
READY = {
    "start": "#forecast-assumption",
    "session": "main h1",
    "cell": "#cell[data-frames]",
    "preview": "#preview:not([data-images='0'])",
    "sessions": "tbody tr",
    "queue": "#queue-state",
    "rig": "[data-key]",
    "calibration": "#noise-values",
}
"""What a screen shows once it has read everything."""
SCREENS = tuple(READY)
SCHEMES = ("light", "dark")
LANGUAGES = {"de": "Deutsch", "en": "English"}


def assert_accessible(page: Page, what: str) -> None:
    """Runs axe-core on what a page shows, details opened, in both languages, light and dark."""
    axe = Axe()
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        for language, name in LANGUAGES.items():
            if page.evaluate("document.documentElement.lang") != language:
                page.get_by_role("button", name=name).click()
            page.locator("main [aria-busy=true]").first.wait_for(state="detached")
            until(page, "document.getAnimations().every((one) => one.playState !== 'running')")  # colours change slowly
            found = axe.run(page)
            assert found.violations_count == 0, (what, scheme, language, found.generate_report())


def test_page_screens_have_no_finding_of_axe(opened: Callable[..., Page], lab: Lab) -> None:
    lab.client.create(Recipe(label="listed"))
    lab.client.enqueue("coin")
    page = opened(Role.ADMIN)
    for screen, ready in READY.items():
        page.goto(f"{lab.url}/#/{screen}")
        page.locator(ready).first.wait_for(timeout=COMPUTED_WITHIN_MS)
        assert_accessible(page, screen)


def test_page_sign_in_has_no_finding_of_axe(context: BrowserContext, console: Console, lab: Lab) -> None:
    page = console.watch(context.new_page())
    page.goto(f"{lab.url}/")
    page.get_by_label("Key", exact=True).fill("lightpose_wrong")
    page.get_by_role("button", name="Sign in").click()
    page.locator("sign-in [role=alert]").wait_for()
    assert_accessible(page, "sign-in")


def test_page_session_s_screens_have_no_finding_of_axe(opened: Callable[..., Page], lab: Lab) -> None:
    earlier = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="earlier"))
    wait_for(lab, earlier, State.COMPLETED)
    session_id = lab.start(Recipe(pilot_lights=4, planned_lights=2, review_plan=True, label="axe"))
    page = opened(Role.ADMIN, f"#/sessions/{session_id}")
    page.locator(".images img").first.wait_for()
    assert_accessible(page, "progress of a running session")
    wait_for(lab, session_id, State.PAUSED)
    page.goto(f"{lab.url}/#/sessions/{session_id}/plan")
    page.locator("#sigma-picture").wait_for()
    page.locator(".dome .light").first.focus()
    assert_accessible(page, "review")
    lab.client.resume(session_id)
    wait_for(lab, session_id, State.COMPLETED)
    page.goto(f"{lab.url}/#/sessions/{session_id}")
    page.locator(".images img").nth(5).wait_for()
    assert_accessible(page, "progress of a completed session")
    page.goto(f"{lab.url}/#/sessions/{session_id}/result")
    page.locator("#map").wait_for()
    page.locator("#compare-with").select_option(index=1)
    page.locator("canvas[data-side='2']").wait_for()
    for shown in ("depth", "relit"):
        page.locator(f"[data-map={shown}]").click()
        assert_accessible(page, f"result, {shown}")


def wait_for(lab: Lab, session_id: str, wanted: State) -> None:
    """Waits for a state of a session, resuming it where the watchdog interrupts it on a busy machine."""
    while lab.client.wait(session_id).state is not wanted:
        lab.resume_if_interrupted(session_id)


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
