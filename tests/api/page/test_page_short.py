"""The operator's page: a stop in mid-move, a start during an outage, in headless Chromium against the real service."""

import re
from collections.abc import Callable
from functools import partial

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api.rest.keys import Role
from hardware_sim.controller.control import ControlClient
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.conftest import COMPUTED_WITHIN_MS, Lab
from tests.api.page.pictures import contrast
from tests.api.page.weak_network import WeakNetwork, target_of
from tests.end_to_end.processes import rests_after, wait_until_moving

pytestmark = pytest.mark.timeout(600)
PROXY = "127.0.49.4"
OUTAGE_MS = 4_000
DELIVERED_MS = 1_500
"""Time of an outage after it was noticed, and in which what it held up arrives, ms."""

SETTLED_MS = 1_500
"""Time in which a request that a press has caused would have been sent, ms."""


def test_page_stop_by_mouse_in_mid_move_halts_arm(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(place="#/start")
    page.get_by_label("Label").fill("stopped by mouse")
    page.get_by_role("button", name="Start", exact=True).click()
    page.locator("#session-state[data-state=running]").wait_for()
    page.get_by_role("link", name="Cell").click()
    page.locator("#cell[data-frames]").wait_for()
    assert contrast(page.locator("#cell canvas")) > 5
    with ControlClient(lab.cell.address) as control:
        wait_until_moving(control, COMPUTED_WITHIN_MS / 1e3)
        box = page.locator("#stop").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 20, box["y"] + 20)
        page.mouse.down()  # and not up: it acts on the press
        rests_after(control)
    expect(page.locator("#stop-told")).to_have_text(re.compile(r"^Stop heard after"))
    page.mouse.up()
    session = next(iter(lab.client.sessions()))
    assert lab.client.wait(session.id).state == "stopped"
    expect(page.get_by_role("region", name="stop")).to_contain_text("The cell was stopped by the software's stop")
    page.goto(f"{lab.url}/#/sessions/{session.id}")
    expect(page.locator("#session-stopped")).to_have_text(re.compile(r"\S stopped the cell, and with it the session, "))
    lab.client.acknowledge()


def test_page_of_a_stopped_session_tells_why_it_was_interrupted(opened: Callable[..., Page], lab: Lab) -> None:
    session_id = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="interrupted, then stopped"))
    with ControlClient(lab.cell.address) as control:
        control.fault("protective_stop")
        interrupted = lab.client.wait(session_id)
        control.fault("clear")
    assert interrupted.state is State.INTERRUPTED
    assert interrupted.reason is not None
    page = opened(place=f"#/sessions/{session_id}")
    expect(page.locator("#session-reason")).to_contain_text(interrupted.reason.detail)
    lab.client.stop(session_id)

    before = page.locator("#session-before")
    expect(before).to_contain_text("Before that the session was interrupted: ")
    expect(before).to_contain_text(interrupted.reason.detail)
    expect(page.locator("#session-stopped")).to_have_text(re.compile(r"\S stopped the session, "))
    expect(page.locator("#session-reason")).to_have_count(0)


def acknowledge(lab: Lab) -> None:
    """Acknowledges what the controller's watchdog has stopped on a busy machine."""
    if not lab.client.safety().clear:
        lab.client.acknowledge()


def test_page_start_pressed_in_outage_moves_nothing(context: BrowserContext, console: Console, lab: Lab) -> None:
    """The network delivers it when it is back; then it has expired."""
    session = lab.client.create(Recipe(label="in an outage"))
    with WeakNetwork(PROXY, target_of(lab.url)) as network:
        place = f"{network.url}/#/sessions/{session.id}"
        page = chromium.open_page(context, console, place, lab.secrets[Role.OPERATOR])
        start = page.locator("[data-action=start]")
        acknowledge(lab)
        expect(start).to_be_enabled()
        network.hold()
        start.click()
        expect(page.locator("#in-charge")).to_have_text("Sending: Start …")
        expect(start).to_be_disabled()
        page.locator("#connection[data-stale=true]").wait_for()
        expect(page.locator("#failure")).to_contain_text("Start: The service did not answer")
        expect(page.locator("session-screen .why")).to_contain_text("without a connection nothing that moves")
        expect(start).to_be_disabled()
        page.wait_for_timeout(OUTAGE_MS)
        network.restore()
        page.locator("#connection[data-stale=false]").wait_for()
        acknowledge(lab)
        expect(start).to_be_enabled()
        page.wait_for_timeout(DELIVERED_MS)
    assert lab.client.session(session.id).state is State.CREATED
    lab.client.stop(session.id)


def test_page_stop_acts_for_screen_reader_and_voice(opened: Callable[..., Page], lab: Lab) -> None:
    """They send a click without pointer and without key."""
    page = opened(Role.VIEWER, "#/start")
    session_id = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="stopped by voice"))
    with ControlClient(lab.cell.address) as control:
        wait_until_moving(control, COMPUTED_WITHIN_MS / 1e3)
        page.locator("#stop").evaluate("(button) => button.click()")
        rests_after(control)
    page.locator("#stop-told.heard").wait_for()
    assert lab.client.wait(session_id).state is State.STOPPED


def test_page_stop_is_sent_once_by_pointer_and_by_keys(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.VIEWER, "#/start")
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.url.endswith("/rig/stop") else None)
    for number, press in enumerate(
        (page.locator("#stop").click, *(partial(press_key, page, key) for key in (" ", "Enter")))
    ):
        press()
        page.locator("#stop-told.heard").wait_for()
        page.wait_for_timeout(SETTLED_MS)
        assert len(sent) == number + 1


def press_key(page: Page, key: str) -> None:
    """Presses and releases a key on STOP."""
    page.locator("#stop").press(key)


def test_page_enter_in_field_starts_nothing(opened: Callable[..., Page], lab: Lab) -> None:
    """A scanner of bar codes ends each label by Enter."""
    before = {session.id for session in lab.client.sessions()}
    page = opened(Role.OPERATOR, "#/start")
    expect(page.locator("#start")).to_be_enabled()
    page.get_by_label("Label").fill("0815")
    page.get_by_label("Label").press("Enter")
    page.get_by_label("Pilot lights").press("Enter")
    page.wait_for_timeout(SETTLED_MS)
    assert {session.id for session in lab.client.sessions()} == before
    assert lab.client.rig().holder is None
    expect(page.get_by_label("Label")).to_have_value("0815")
    expect(page.locator("#recipe button[hidden]")).to_be_hidden()
