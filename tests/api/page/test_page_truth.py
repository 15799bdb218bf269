"""What the page says is true of now: motion, questions of a stop, refusals, old images, what keeps a button grey."""

import json
import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, Route, expect

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api.rest.keys import Role
from hardware_sim.controller.control import ControlClient
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab
from tests.api.page.test_page_access import wait_for
from tests.api.page.test_page_screens import hold_until_moved
from tests.end_to_end.processes import rests_after

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]


def test_page_tells_motion_without_session(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    motion = page.locator("#arm-motion")
    expect(motion).to_have_text("ARM AT REST")
    state = page.locator("#rig-state")

    def motion_is_told() -> bool:
        return motion.text_content() == "ARM MOVES" and "The arm moves without a session" in (
            state.text_content() or ""
        )

    hold_until_moved(page, lab, motion_is_told)
    page.mouse.up()
    with ControlClient(lab.cell.address) as control:
        rests_after(control)
    expect(motion).to_have_text("ARM AT REST")
    rested = lab.joints()
    button = page.get_by_role("button", name="Joint 1 +")
    button.hover()
    page.mouse.down(button="right")
    page.wait_for_timeout(500)
    expect(button).to_have_attribute("aria-pressed", "false")
    page.mouse.up(button="right")
    assert abs(lab.joints()[0] - rested[0]) < 1e-3
    page.locator("#park:enabled").click()
    expect(page.locator("#parked")).to_contain_text("The arm is at home.", timeout=COMPUTED_WITHIN_MS)


def test_page_jog_names_the_press_that_is_released(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    button = page.get_by_role("button", name="Joint 1 +")
    expect(button).to_be_enabled()
    button.hover()
    with (
        page.expect_request("**/v1/rig/jog") as pressed,
        page.expect_request("**/v1/rig/jog/release") as released,
    ):
        page.mouse.down()
        page.mouse.up()
    names = [(request.value.post_data_json or {}).get("hold") for request in (pressed, released)]
    assert names[0]
    assert names[0] == names[1]
    assert "valid-until" in pressed.value.headers


def test_page_asks_anew_for_each_stop(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    notice = page.get_by_role("region", name="A safety stop must be acknowledged")
    ask, tick = notice.get_by_role("button", name="Acknowledge …"), notice.get_by_role("checkbox")
    for _ in range(2):
        page.keyboard.press("Escape")
        expect(page.locator("rig-screen .why").first).to_contain_text("must be acknowledged first")
        expect(page.locator("#park")).to_be_disabled()
        ask.click()  # the first time's tick does not stand here
        expect(tick).to_be_focused()
        expect(tick).not_to_be_checked()
        tick.check()
        lab.client.acknowledge()  # somebody else
        expect(notice).to_have_count(0)


def interrupted(route: Route) -> None:
    """A session's answer, as that of one which waits for a person."""
    body = route.fetch().json()
    reason = {"code": "arm.elsewhere", "title": "", "detail": "It was moved", "remedy": ""}
    route.fulfill(json={**body, "state": "interrupted", "allowed_actions": ["resume", "stop"], "reason": reason})


def test_page_question_of_one_session_is_not_that_of_another(opened: Callable[..., Page], lab: Lab) -> None:
    one, other = (lab.client.create(Recipe(label=label)) for label in ("one", "other"))
    page = opened(Role.OPERATOR)
    for session in (one, other):
        page.route(f"**/v1/sessions/{session.id}", interrupted)
    page.goto(f"{lab.url}/#/sessions/{one.id}")
    question = page.get_by_role("group", name="Resume")
    page.locator("[data-action=resume]").click()
    question.get_by_role("checkbox").check()
    question.get_by_role("button", name="Cancel").click()
    page.locator("[data-action=resume]").click()
    expect(question.get_by_role("checkbox")).not_to_be_checked()
    question.get_by_role("checkbox").check()
    page.get_by_role("button", name="Edit label and notes").click()
    page.evaluate(f"location.hash = '#/sessions/{other.id}'")
    expect(page.locator("h1")).to_have_text("other")
    expect(question).to_have_count(0)
    expect(page.get_by_label("Notes")).to_have_count(0)
    page.locator("[data-action=resume]").click()
    expect(question.get_by_role("checkbox")).not_to_be_checked()


def test_page_refusal_is_in_view_and_keeps_what_was_written(opened: Callable[..., Page], lab: Lab) -> None:
    session = lab.client.create(Recipe(label="noted"))
    page = opened(Role.OPERATOR, f"#/sessions/{session.id}")
    page.get_by_role("button", name="Edit label and notes").click()
    page.get_by_label("Notes").fill("the rim is chipped")
    problem = {"code": "store.unwritable", "title": "", "detail": "The disk fails", "remedy": "", "status": 503}
    page.route(
        f"**/v1/sessions/{session.id}",
        lambda route: (
            route.fulfill(status=503, body=json.dumps(problem))
            if route.request.method == "PATCH"
            else route.continue_()
        ),
    )
    page.get_by_role("button", name="Save").click()
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    expect(page.locator("#failure")).to_be_in_viewport()
    expect(page.locator("#failure")).to_contain_text("Save: The data folder cannot be written")
    expect(page.get_by_label("Notes")).to_have_value("the rim is chipped")
    page.get_by_role("link", name="Rig").click()
    expect(page.locator("#failure")).to_have_count(0)


def test_page_counts_no_images_that_could_not_be_read(opened: Callable[..., Page], lab: Lab) -> None:
    session = lab.client.create(Recipe(label="unread"))
    page = opened(Role.OPERATOR)
    passes = f"**/v1/sessions/{session.id}/passes**"
    page.route(passes, lambda route: route.abort())
    page.goto(f"{lab.url}/#/sessions/{session.id}/images")
    expect(page.locator("#image-count")).to_have_text("–")
    expect(page.locator("session-progress [role=alert]")).to_contain_text("does not answer")
    page.unroute(passes)
    expect(page.locator("#image-count")).to_have_text("0")


def test_page_old_image_is_not_called_live(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/preview")
    expect(page.locator("#preview-age")).to_have_text("The camera's image now")
    page.locator("#preview:not([data-images='0'])").wait_for()
    page.route("**/v1/rig/preview.jpg", lambda route: route.abort())
    expect(page.locator("#preview-age")).to_have_text(re.compile(r"Image of \d\d:\d\d:\d\d; none since"))
    expect(page.locator("#preview")).to_have_class("old")
    expect(page.locator("preview-screen [role=alert]")).to_contain_text("does not answer")
    page.unroute("**/v1/rig/preview.jpg")
    expect(page.locator("#preview-age")).to_have_text("The camera's image now")


def test_page_says_why_new_session_cannot_go_on(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/start")
    queue = page.get_by_role("button", name="Add to the queue")
    expect(queue).to_be_disabled()
    # Beside it stands why no session starts while the cell is not connected, as after a stop by the watchdog.
    why = page.locator(".beside-form .why", has_text="needs a label")
    expect(why).to_be_visible()
    page.get_by_label("Label").fill("a coin")
    expect(queue).to_be_enabled()
    expect(why).to_have_count(0)
    settings = page.locator("recipe-form details")
    settings.locator("summary").click()
    page.get_by_label("Retakes of a bad image").fill("-3")
    settings.locator("summary").click()
    expect(page.get_by_label("Retakes of a bad image")).to_be_hidden()
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.get_by_label("Retakes of a bad image")).to_be_focused()
    assert [one.label for one in lab.client.sessions() if one.label == "a coin"] == []


def test_page_picture_of_sigma_that_failed_is_requested_again(opened: Callable[..., Page], lab: Lab) -> None:
    session_id = lab.start(Recipe(pilot_lights=4, planned_lights=2, review_plan=True))
    wait_for(lab, session_id, State.PAUSED)
    page = opened(Role.OPERATOR)
    problem = {"code": "rig.busy", "title": "", "detail": "A session is working", "remedy": "", "status": 409}
    refusals = [json.dumps(problem)]

    def refuse_once(route: Route) -> None:
        if route.request.headers["accept"] == "image/png" and refusals:
            route.fulfill(status=409, body=refusals.pop())
        else:
            route.continue_()

    page.route("**/plan/forecast", refuse_once)
    page.goto(f"{lab.url}/#/sessions/{session_id}/plan")
    page.locator("#sigma-picture").wait_for()
    assert refusals == []
    expect(page.locator("plan-review [role=alert]")).to_have_count(0)
    lab.client.stop(session_id)
