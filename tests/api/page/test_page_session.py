"""A session by clicks: from sign-in over the reviewed plan to the download of the normals."""

import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from playwright.sync_api import BrowserContext, Page, Route, expect

from api.rest.keys import Role
from tests.api.page.conftest import COMPUTED_WITHIN_MS, HANGING_S, Lab
from tests.api.page.pictures import contrast, pixels

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]


def drag(page: Page, light: int, right: float, down: float) -> None:
    """Drags a light of the plot by pixels of the screen."""
    box = page.locator(f".dome .light[data-light='{light}'] circle").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=12)
    page.mouse.up()


def resume_where_watchdog_stopped(page: Page, wanted: str) -> None:
    """Waits for a state of the session; on a busy machine the watchdog interrupts it, and a person resumes."""
    for _ in range(8):
        page.locator(f"#session-state[data-state={wanted}], #session-state[data-state=interrupted]").wait_for(
            timeout=COMPUTED_WITHIN_MS
        )
        if page.locator("#session-state").get_attribute("data-state") == wanted:
            return
        page.locator("[data-action=resume]").click()
        page.locator("[data-confirm=resume]").click()
        page.locator("#session-state:not([data-state=interrupted])").wait_for()
    raise AssertionError(f"the session does not become {wanted}")


def draw_line(page: Page) -> None:
    """Draws a line across the middle of the map."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + box["height"] / 2, steps=6)
    page.mouse.up()


def check_large_maps(page: Page, lab: Lab) -> None:
    """Shows the same maps with ten times the width: drawn reduced, read in full."""
    small = page.evaluate("document.querySelector('map-viewer').profile.along.at(-1)")
    answer = next(iter(lab.client.sessions())).answer
    assert answer is not None
    tenfold = np.ones((10, 10), np.float32)

    def enlarged(route: Route) -> None:
        content = lab.get(route.request.url.removeprefix(lab.url)).content
        if route.request.url.endswith(".tiff"):
            larger = BytesIO()
            tifffile.imwrite(larger, np.kron(tifffile.imread(BytesIO(content)), tenfold), photometric="minisblack")
            route.fulfill(body=larger.getvalue(), content_type="image/tiff")
        else:
            mask = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
            encoded = cv2.imencode(".png", np.kron(mask, tenfold.astype(np.uint8)))[1]  # type: ignore[arg-type]
            route.fulfill(body=encoded.tobytes(), content_type="image/png")

    page.route("**/depth.tiff", enlarged)
    page.route("**/mask.png", enlarged)
    page.reload()
    page.locator("map-viewer").get_by_role("button", name="Depth").click()
    expect(page.locator("map-viewer .scale")).to_be_visible()
    assert page.evaluate("document.querySelector('#map').width") == 640
    draw_line(page)
    page.locator("map-viewer curve-plot canvas").wait_for()
    large = page.evaluate("document.querySelector('map-viewer').profile.along.at(-1)")
    assert large == pytest.approx(small, rel=0.05)
    page.unroute_all()
    page.reload()


def check_profile(page: Page, lab: Lab) -> None:
    """Compares the drawn profile with the depth map: points placed by the camera's intrinsics, mm."""
    line, profile = page.evaluate("(({line, profile}) => [line, profile])(document.querySelector('map-viewer'))")
    answer = next(iter(lab.client.sessions())).answer
    assert answer is not None
    depth = tifffile.imread(BytesIO(lab.get(f"{answer.links['self']}/depth.tiff").content))
    (focal, _, centre), _, _ = lab.client.scene().camera.camera_matrix
    row, columns = line[0][1], np.arange(line[0][0], line[1][0] + 1)
    z = depth[row, columns]
    solved = np.flatnonzero(z > 0)
    x = (columns - centre) / focal * z
    assert profile["along"][-1] == pytest.approx(1e3 * (x[solved[-1]] - x[solved[0]]), abs=0.5)
    heights = [height for height in profile["height"] if height is not None]
    assert max(heights) == pytest.approx(1e3 * (z[solved].max() - z[solved].min()), abs=0.5)
    assert min(heights) == 0


def test_page_session_from_sign_in_to_download(
    opened: Callable[..., Page], context: BrowserContext, lab: Lab, tmp_path: Path
) -> None:
    page = opened(Role.OPERATOR, "#/start")
    page.get_by_text("With review", exact=True).click()
    page.get_by_label("Label").fill("coin, obverse")
    page.get_by_role("spinbutton", name="Planned lights").fill("2")
    expect(page.locator("#dry-run-lights")).to_have_text("4", timeout=COMPUTED_WITHIN_MS)
    expect(page.locator("#dry-run-sigma")).to_contain_text("°")
    assert contrast(page.locator("start-screen curve-plot canvas")) > 2
    page.get_by_role("button", name="Start", exact=True).click()
    resume_where_watchdog_stopped(page, "paused")
    expect(page.locator("#rig-state")).to_contain_text("coin, obverse: paused")
    expect(page.locator("app-bar")).to_contain_text("In charge: operator")
    expect(page.locator("#image-count")).to_have_text("4")
    assert contrast(page.locator(".images img").first) > 5

    # The plan's review: a light is dragged, the forecast follows; one is dragged out of reach and back.
    page.get_by_role("link", name="Review the lights").click()
    sigma = page.locator("#sigma-forecast")
    sigma.wait_for()
    page.locator("#sigma-picture").wait_for()
    lights = page.get_by_role("group", name="Lights").locator("tbody tr")
    expect(lights).to_have_count(2)
    expect(lights.first).to_contain_text(re.compile(r"σ would be [\d.]+\s% larger without it"))
    planned, before = sigma.inner_text(), page.locator("#sigma-picture").get_attribute("src")
    drag(page, 0, 60, 25)
    expect(sigma).not_to_have_text(planned)
    expect(page.locator("#sigma-picture")).not_to_have_attribute("src", str(before))
    assert contrast(page.locator("#sigma-picture")) > 5
    page.get_by_role("button", name="Undo changes").click()
    expect(sigma).to_have_text(planned)
    page.locator(".dome .light[data-light='1']").focus()
    page.keyboard.press("ArrowUp")
    expect(sigma).not_to_have_text(planned)
    page.keyboard.press("ArrowDown")
    page.get_by_role("button", name="Add a light").click()
    expect(page.locator(".dome .light")).to_have_count(3)
    page.get_by_role("button", name="Remove the light").click()
    expect(page.locator(".dome .light")).to_have_count(2)
    page.locator("#accept-plan").click()
    resume_where_watchdog_stopped(page, "completed")

    # The result: maps, movable light, profile, comparison, download.
    page.get_by_role("link", name="Result").click()
    expect(page.locator("#mean-sigma")).to_contain_text("°")
    expect(page.locator("result-view")).to_contain_text("× the stated noise")  # fit of the images, in words
    for name in ("Normals", "Albedo", "Uncertainty σ", "Depth", "Residual"):
        page.locator("map-viewer").get_by_role("button", name=name).click()
        expect(page.locator("map-viewer figure")).to_have_attribute("aria-busy", "false")
        assert contrast(page.locator("#map")) > 5, name
    page.locator("map-viewer").get_by_role("button", name="Depth").click()
    draw_line(page)
    assert contrast(page.locator("map-viewer curve-plot canvas")) > 2
    check_profile(page, lab)
    check_large_maps(page, lab)
    page.get_by_role("button", name="Movable light").click()
    relit = page.locator("#relit")
    expect(page.locator("map-viewer figure")).to_have_attribute("aria-busy", "false")
    left = pixels(relit).astype(float)
    relit.focus()
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    assert np.abs(pixels(relit).astype(float) - left).mean() > 2
    page.locator("#compare-with").select_option(index=1)
    expect(page.locator("result-comparison")).to_contain_text("median")
    assert contrast(page.locator("canvas[data-side='2']")) > 2
    with page.expect_download() as downloading:
        page.locator("[data-file='normals.png']").click()
    downloading.value.save_as(tmp_path / "normals.png")
    normals = cv2.imread(str(tmp_path / "normals.png"), cv2.IMREAD_UNCHANGED)
    assert normals is not None
    assert normals.dtype == np.uint16
    assert normals.shape == (128, 128, 3)
    with context.expect_page() as opening:
        page.get_by_role("button", name="Open the report").click()
    expect(opening.value.locator("h1")).to_be_visible()
