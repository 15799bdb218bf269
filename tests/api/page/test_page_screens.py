"""The screens of cell, camera and sessions: pixels, the arm's motion, a region that is drawn."""

import contextlib
import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api.client.responses import ProblemError
from api.rest.keys import Role
from hardware_sim.controller.control import ControlClient
from tests.api.page.chromium import until
from tests.api.page.conftest import HANGING_S, Lab
from tests.api.page.pictures import contrast, pixels
from tests.end_to_end.processes import rests_after

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
AWAY_RAD = 0.5
MOVED_WITHIN_S = 240.0
"""Time in which a held button moves the arm, s: on a busy machine in many short holds."""


def frames(page: Page) -> int:
    """Pictures of the cell drawn so far."""
    return int(page.locator("#cell").get_attribute("data-frames") or 0)


def pause_away_from_home(lab: Lab) -> str:
    """Starts sessions until one rests with the arm away from home; on a busy machine a whole one may pass unseen."""
    home = np.array(lab.client.scene().arm.home)
    while True:
        session_id = lab.start(Recipe(pilot_lights=8, planned_lights=0))
        while lab.client.session(session_id).state is State.RUNNING and np.abs(lab.joints() - home).max() < AWAY_RAD:
            time.sleep(0.02)
        with contextlib.suppress(ProblemError):  # it has ended
            lab.client.pause(session_id)
        while lab.client.session(session_id).state in (State.RUNNING, State.PAUSING):
            time.sleep(0.02)
        if np.abs(lab.joints() - home).max() > AWAY_RAD:
            return session_id
        lab.settle()


def test_page_cell_follows_moving_arm(opened: Callable[..., Page], lab: Lab) -> None:
    assert lab.get("/v1/rig/reach").is_success  # once it is known the view is made anew, with the candidates
    page = opened(Role.OPERATOR, "#/cell")
    page.locator("#cell[data-frames]").wait_for()
    canvas = page.locator("#cell canvas")
    at_home = pixels(canvas).astype(float)
    assert contrast(canvas) > 5
    page.wait_for_timeout(1_000)
    still = frames(page)
    page.wait_for_timeout(1_000)
    assert frames(page) - still <= 2  # an arm at rest is not drawn again
    before = frames(page)
    session_id = pause_away_from_home(lab)
    joints = lab.joints().tolist()
    until(page, f"{joints}.every((angle, index) => Math.abs(angle - lightpose.joints.joints[index]) < 1e-3)")
    page.wait_for_timeout(500)
    assert frames(page) >= before + 3
    assert np.mean(np.abs(pixels(canvas).astype(float) - at_home) > 20) > 0.002  # the arm stands elsewhere
    lab.client.stop(session_id)
    lab.client.wait(session_id)
    stopped = pixels(canvas).astype(float)
    page.locator("#cell").focus()
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(500)
    assert np.abs(pixels(canvas).astype(float) - stopped).mean() > 1
    numbered = pixels(canvas).astype(float)
    page.get_by_label("Numbers").uncheck()
    page.wait_for_timeout(500)
    assert np.mean(np.abs(pixels(canvas).astype(float) - numbered) > 20) > 1e-4
    page.locator("#cell").focus()
    for _ in range(5):
        page.keyboard.press("+")
    page.wait_for_timeout(500)
    near = pixels(canvas).astype(float)
    page.get_by_role("button", name="Show everything").click()
    page.wait_for_timeout(500)
    assert np.abs(pixels(canvas).astype(float) - near).mean() > 1
    with page.expect_download() as downloading:
        page.get_by_role("button", name="Save the picture").click()
    assert downloading.value.suggested_filename == "cell.png"
    page.evaluate("window.shown = document.querySelector('#cell canvas')")
    page.get_by_role("link", name="Rig").click()
    expect(page.locator("#cell")).to_have_count(0)
    page.get_by_role("link", name="Cell").click()
    page.locator("#cell[data-frames]").wait_for()
    assert page.evaluate("document.querySelector('#cell canvas') === window.shown")  # new views would fill the memory
    assert contrast(canvas) > 5


def test_page_region_drawn_by_polygon_is_saved(opened: Callable[..., Page], lab: Lab) -> None:
    session = lab.client.create(Recipe(label="with a region"))
    page = opened(Role.OPERATOR, f"#/preview/{session.id}")
    page.locator("#preview:not([data-images='0'])").wait_for()
    page.get_by_role("button", name="Polygon", exact=True).click()
    page.locator("#preview").scroll_into_view_if_needed()
    box = page.locator("#preview").bounding_box()
    assert box is not None
    for x, y in ((0.25, 0.25), (0.75, 0.25), (0.75, 0.5), (0.25, 0.5)):
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.get_by_role("button", name="Save the region").click()
    expect(page.get_by_text("Saved:")).to_be_visible()
    answer = lab.get(f"/v1/sessions/{session.id}/region.png")
    mask = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    assert mask.shape == (128, 128)
    assert np.mean(mask[34:62, 34:94] > 127) > 0.97
    assert np.mean(mask > 127) == pytest.approx(0.125, abs=0.02)


def test_page_sessions_are_found_and_deleted(opened: Callable[..., Page], lab: Lab) -> None:
    for label in ("vase A", "vase B", "coin"):
        lab.client.create(Recipe(label=label))
    page = opened(Role.ADMIN, "#/sessions")
    page.get_by_label("Search").fill("vase")
    expect(page.locator("tbody tr")).to_have_count(2)
    row = page.locator("tbody tr", has_text="vase B")
    row.get_by_role("button", name="Delete").click()
    row.get_by_role("button", name="Delete").click()
    expect(page.locator("tbody tr")).to_have_count(1)
    assert "vase B" not in {session.recipe.label for session in lab.client.sessions()}


def test_page_queue_takes_orders_and_removes_entries(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/start")
    for label in ("coin", "vase"):
        page.goto(f"{lab.url}/#/start")
        page.get_by_label("Label").fill(label)
        page.get_by_role("button", name="Add to the queue").click()
        expect(page.locator("tbody tr", has_text=label)).to_contain_text("waiting")
    page.locator("tbody tr", has_text="vase").get_by_role("button", name="Earlier").click()
    expect(page.locator("tbody tr").first).to_contain_text("vase")
    page.locator("tbody tr", has_text="coin").get_by_role("button", name="Remove").click()
    expect(page.locator("tbody tr")).to_have_count(1)
    page.get_by_role("button", name="Go on …").click()
    expect(page.get_by_text("Is “vase” in place")).to_be_visible()
    page.get_by_role("button", name="Yes: go on").click()
    page.locator("tbody tr", has_text="running").get_by_role("link", name="vase").click()
    page.locator("#session-state").wait_for()
    page.keyboard.press("Escape")
    page.locator("#stop-told.heard").wait_for()
    page.goto(f"{lab.url}/#/queue")
    expect(page.locator("#queue-state")).to_have_attribute("data-state", "stopped")


def test_page_label_and_notes_are_edited(opened: Callable[..., Page], lab: Lab) -> None:
    session = lab.client.create(Recipe(label="misspelt"))
    page = opened(Role.OPERATOR, f"#/sessions/{session.id}")
    page.get_by_role("button", name="Edit label and notes").click()
    page.get_by_label("Label").fill("spelt")
    page.get_by_label("Notes").fill("<b>bold</b> is text here")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("h1")).to_have_text("spelt")
    expect(page.locator(".notes")).to_contain_text("<b>bold</b> is text here")
    assert lab.client.session(session.id).label == "spelt"


def hold_until_moved(page: Page, lab: Lab, seen: Callable[[], bool] = lambda: True) -> None:
    """Holds a button until the base joint has moved and `seen` is true meanwhile.

    On a busy machine the hold lapses; the button is then pressed again.
    """
    button = page.get_by_role("button", name="Joint 1 +")
    begun, deadline = lab.joints()[0], time.monotonic() + MOVED_WITHIN_S
    while time.monotonic() < deadline:
        if not lab.client.safety().clear:  # the watchdog has stopped the arm
            lab.client.acknowledge()
        expect(button).to_be_enabled()
        button.hover()  # where it is now: notices above it come and go
        page.mouse.down()
        while button.get_attribute("aria-pressed") == "true":
            if abs(lab.joints()[0] - begun) > 0.06 and seen():
                return
            page.wait_for_timeout(50)
        page.mouse.up()
    raise AssertionError("the arm does not move")


def test_page_jog_moves_arm_only_while_held(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.OPERATOR, "#/rig")
    home = lab.joints()
    hold_until_moved(page, lab)
    page.mouse.up()
    with ControlClient(lab.cell.address) as control:
        rests_after(control)
    rested = lab.joints()
    assert abs(rested[0] - home[0]) > 0.05
    assert np.abs(rested[1:] - home[1:]).max() < 0.01
    page.wait_for_timeout(500)
    assert np.abs(lab.joints() - rested).max() < 1e-3


def test_page_lists_keys_and_calibration(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(Role.ADMIN, "#/rig")
    for role in Role:
        expect(page.locator(f"[data-key='{role}']")).to_contain_text(str(role))
    for secret in lab.secrets.values():
        assert secret not in page.content()
    page.goto(f"{lab.url}/#/calibration")
    known = lab.client.calibration()
    expect(page.locator(".fingerprint")).to_have_text(known.fingerprint)
    expect(page.locator("#camera-values")).to_contain_text(f"{known.values.camera_matrix[0][0]:.1f}")
    expect(page.locator("#lamp-values")).to_contain_text(f"{1e3 * known.values.reference_m:.0f} mm")
    expect(page.locator("#noise-values")).to_contain_text(f"{known.values.sensor.read_noise_e:.1f} e")
