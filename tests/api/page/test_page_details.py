"""What single screens tell: preview figures, filters, time left, comparison of sessions, and how the arm is parked."""

import re
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from acquisition.models.recipe import Exposure, Recipe
from acquisition.session import SAME_JOINTS_RAD
from acquisition.session_state import State
from api.rest.keys import Role
from hardware_sim.controller.control import ControlClient
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab
from tests.api.page.pictures import contrast, pixels
from tests.api.page.test_page_access import wait_for
from tests.api.page.test_page_screens import hold_until_moved
from tests.end_to_end.processes import rests_after

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]


def test_page_preview_tells_histogram_clipping_and_focus(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.VIEWER, "#/preview")
    page.locator("#preview:not([data-images='0'])").wait_for()
    figures = page.locator("preview-figures")
    figures.locator(".histogram rect").nth(63).wait_for(state="attached")
    heights = [float(bar.get_attribute("height") or 0) for bar in figures.locator(".histogram rect").all()]
    assert max(heights) > 10
    expect(figures.locator("meter").first).to_be_visible()
    before = pixels(page.locator("#preview")).astype(float)
    figures.get_by_role("checkbox").check()  # the lamp is off: all pixels are black, and marked so in blue
    blue = page.locator("#preview")
    for _ in range(300):
        picture = pixels(blue).astype(float)
        if (picture[..., 0] - picture[..., 2]).mean() > (before[..., 0] - before[..., 2]).mean() + 20:
            break
        page.wait_for_timeout(200)
    else:
        raise AssertionError("nothing is marked as clipped")


@pytest.mark.parametrize(
    ("exposure_s", "shown"), [(0.00023, "0.23"), (0.0125, "12.5"), (0.05, "50"), (1.2344, "1,234")]
)
def test_page_exposure_has_its_digits(opened: Callable[..., Page], lab: Lab, exposure_s: float, shown: str) -> None:
    page = opened(Role.VIEWER)

    def answer(route: Route) -> None:
        found = route.fetch()
        route.fulfill(response=found, json=found.json() | {"exposure_s": exposure_s})

    page.route("**/v1/rig/preview/figures", answer)
    page.goto(f"{lab.url}/#/preview")
    exposure = page.locator("preview-figures div", has_text="Exposure").locator("dd")
    expect(exposure).to_have_text(re.compile(f"^{shown}\\sms$"))


def test_page_region_drawn_by_brush_is_saved(opened: Callable[..., Page], lab: Lab) -> None:
    session = lab.client.create(Recipe(label="brushed"))
    page = opened(Role.OPERATOR, f"#/preview/{session.id}")
    page.locator("#preview:not([data-images='0'])").wait_for()
    page.locator("[data-tool=brush]").click()
    page.locator("#preview").scroll_into_view_if_needed()
    box = page.locator("#preview").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"], steps=8)
    page.mouse.up()
    page.locator("#save-region").click()
    expect(page.get_by_text("Saved:")).to_be_visible()
    content = lab.get(f"/v1/sessions/{session.id}/region.png").content
    mask = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    assert mask[64, 56:72].min() > 127
    assert 0.001 < np.mean(mask > 127) < 0.1


def test_page_form_explains_each_field_in_both_languages(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/start")
    form = page.locator("recipe-form")
    form.locator("summary").click()
    told: list[list[str]] = []
    for switch, heading in (("Deutsch", "Neue Sitzung"), ("English", "New session")):
        page.get_by_role("button", name=switch).click()
        expect(page.locator("h1")).to_have_text(heading)
        fields = form.locator(".field")
        told.append([text.strip() for text in fields.locator("label, small").all_inner_texts()])
        expect(fields.locator("small")).to_have_count(fields.count())
        expect(form.get_by_role("group", name={"Deutsch": "Belichtung"}.get(switch, "Exposure"))).to_be_visible()
    german, english = told
    assert all(german)
    assert all(english)
    assert [words for words in german if words in english] == []
    way = form.get_by_role("group", name="Taking images").get_by_role("checkbox", name="While the arm moves")
    expect(way).to_have_accessible_description(re.compile("taken again at rest"))
    way.check()
    form.get_by_label("Fixed exposure time, s").fill("0.02")
    form.get_by_label("Label").fill("on the way")
    page.get_by_role("button", name="Save without starting").click()
    expect(page.locator("h1")).to_have_text("on the way")
    (saved,) = [one.recipe for one in lab.client.sessions() if one.label == "on the way"]
    assert isinstance(saved, Recipe)
    assert (saved.capture.while_moving, saved.exposure.seconds) == (True, 0.02)


def test_page_sessions_are_filtered_by_state_and_date(opened: Callable[..., Page], lab: Lab) -> None:
    ended = lab.client.create(Recipe(label="filtered: ended"))
    lab.client.stop(ended.id)
    lab.client.create(Recipe(label="filtered: new"))
    page = opened(Role.OPERATOR, "#/sessions")
    page.get_by_label("Search").fill("filtered")
    expect(page.locator("tbody tr")).to_have_count(2)
    page.get_by_label("State").select_option("stopped")
    expect(page.locator("tbody tr")).to_have_count(1)
    expect(page.locator("tbody tr")).to_contain_text("filtered: ended")
    page.get_by_label("State").select_option("")
    page.get_by_label("Since").fill("2999-01-01")
    expect(page.locator("tbody tr")).to_have_count(0)
    page.get_by_label("Since").fill("2001-01-01")
    expect(page.locator("tbody tr")).to_have_count(2)


def test_page_tells_time_left_then_compares_sessions(opened: Callable[..., Page], lab: Lab) -> None:
    recipe = Recipe(pilot_lights=3, planned_lights=0)
    first = lab.start(recipe.model_copy(update={"label": "compared, first"}))
    wait_for(lab, first, State.COMPLETED)
    usual_s = max(shot.shot.exposure_s for shot in lab.client.one_pass(first, 0).shots)
    too_long = Exposure(seconds=3 * usual_s)
    page = opened(Role.OPERATOR, "#/sessions")  # it tells what has happened since it was opened
    second = lab.start(recipe.model_copy(update={"label": "compared, second", "exposure": too_long}))
    page.goto(f"{lab.url}/#/sessions/{second}")
    left = page.locator(".figures div", has_text="Time left").locator("dd")
    text = ""
    while lab.client.session(second).state is not State.COMPLETED:
        text = left.inner_text()
        if text.endswith((" s", " min")):
            break
        lab.resume_if_interrupted(second)
        page.wait_for_timeout(100)
    assert text.split()[0].isdigit(), text
    wait_for(lab, second, State.COMPLETED)
    expect(page.locator(".events")).to_contain_text("Image taken: Light 3")
    expect(page.locator(".events")).not_to_contain_text("session.")
    expect(page.locator(".images .warns").first).to_contain_text("overexposed")
    page.get_by_role("link", name="Result").click()
    expect(page.locator("result-view")).to_contain_text("Do the images fit the model?")
    page.locator("#compare-with").select_option(label="compared, first")
    page.locator("canvas[data-side='2']").wait_for()
    expect(page.locator("result-comparison")).to_contain_text("median")
    assert contrast(page.locator("canvas[data-side='2']")) > 2


def test_page_safety_notice_tells_remedy_and_asks(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    page.keyboard.press("Escape")
    page.locator("#stop-told.heard").wait_for()
    expect(page.locator("#rig-state")).to_have_text("Stopped: the cell must be inspected")
    notice = page.get_by_role("region", name="A safety stop must be acknowledged")
    expect(notice).to_contain_text("The cell was stopped by the software's stop")
    expect(notice).to_contain_text("Inspect the cell, then acknowledge")
    expect(page.locator(".checks li.bad", has_text="Safety: not in order")).to_be_visible()
    expect(page.locator("[data-check=board]")).to_contain_text("never checked")
    expect(page.locator("rig-screen")).to_contain_text("What to do")
    notice.get_by_role("button", name="Acknowledge …").click()
    confirm = notice.get_by_role("button", name="Acknowledge the stop")
    expect(confirm).to_be_disabled()
    assert not lab.client.safety().clear
    notice.get_by_role("checkbox").check()
    confirm.click()
    expect(notice).to_have_count(0)
    assert lab.client.safety().clear


def test_page_parks_arm_and_jog_ends_with_focus(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    home = lab.joints()
    hold_until_moved(page, lab)
    page.evaluate("window.dispatchEvent(new Event('blur'))")  # another window: the hand is still on the mouse
    with ControlClient(lab.cell.address) as control:
        rests_after(control)
    rested = lab.joints()
    page.wait_for_timeout(1_500)
    assert np.abs(lab.joints() - rested).max() < 1e-3
    page.mouse.up()
    for _ in range(10):
        page.locator("#park:enabled").click()
        page.locator("#park:enabled").wait_for(timeout=COMPUTED_WITHIN_MS)
        if np.abs(lab.joints() - home).max() < SAME_JOINTS_RAD:
            break
        lab.settle()
    assert np.abs(lab.joints() - home).max() < SAME_JOINTS_RAD
    expect(page.locator(".checks li.good")).to_have_count(5)
