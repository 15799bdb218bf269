"""Takes the pictures of the operator's page in the docs: `python docs/page_screenshots.py`, in two minutes or so.

It runs a simulated cell, a service and Debian's Chromium, lets a session wait for its review and be finished, and
photographs the screens. A path as an argument takes the pictures somewhere else.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client
from hardware_sim.cell import Cell, CellOptions
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.end_to_end.processes import serving

PICTURES = Path(__file__).parent / "pictures"
ADDRESS = "127.0.49.200"
LARGEST_BYTES = 150_000
"""Of one picture."""

QUALITY = 80
SIZE = {"width": 1180, "height": 760}
TALL = 1000
"""Height of the window for what stands below one another: dome and forecast, figures and map, px."""

CALIBRATION_HEIGHT = 1180
"""Height of the window for the calibration, px: down to the residuals."""

RECIPE = Recipe(pilot_lights=4, planned_lights=4, review_plan=True, label="Figurine, front")


def wait_for(client: Client, session_id: str, state: State) -> None:
    """Waits for a state, resuming a session that the controller's watchdog has interrupted."""
    while (present := client.wait(session_id).state) is not state:
        if present is not State.INTERRUPTED:
            raise SystemExit(f"the session is {present}, not {state}")
        client.resume(session_id)


def save(page: Page, name: str, folder: Path) -> None:
    """Saves what a page shows as WebP."""
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    path = folder / f"page-{name}.webp"
    cv2.imwrite(str(path), image, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    print(f"{path.name:24} {path.stat().st_size:>8,} bytes", flush=True)
    if path.stat().st_size > LARGEST_BYTES:
        raise SystemExit(f"{path.name} has more than {LARGEST_BYTES} bytes")


def take(page: Page, url: str, client: Client, folder: Path) -> None:
    """Takes the pictures of a session."""

    def shoot(name: str, place: str, ready: Callable[[], None] = lambda: None, height: int = SIZE["height"]) -> None:
        page.set_viewport_size({"width": SIZE["width"], "height": height})
        page.goto(f"{url}/#/{place}")
        page.locator("main h1").wait_for()
        ready()
        page.wait_for_timeout(1_500)
        save(page, name, folder)

    shoot("start", "start", lambda: page.locator("#dry-run-seconds").wait_for())
    session = client.create(RECIPE)
    client.start(session.id)
    wait_for(client, session.id, State.PAUSED)
    shoot("review", f"sessions/{session.id}/plan", lambda: page.locator("#sigma-picture").wait_for(), TALL)
    client.resume(session.id)
    wait_for(client, session.id, State.COMPLETED)
    shoot("progress", f"sessions/{session.id}", lambda: page.locator(".images img").nth(6).wait_for())
    shoot("result", f"sessions/{session.id}/result", lambda: page.locator("#map").wait_for(), TALL)
    page.emulate_media(color_scheme="dark")  # while another screen is shown: the cell is drawn in its colours at once
    shoot("cell", "cell", lambda: page.locator("#cell[data-frames]").wait_for(), TALL - 100)
    page.emulate_media(color_scheme="light")
    client.create(Recipe(label="Coin, obverse", notes="after cleaning"))
    shoot("sessions", "sessions", lambda: page.locator("tbody tr").nth(1).wait_for())
    for name in ("Coin, obverse", "Coin, reverse"):
        client.enqueue(name)
    shoot("queue", "queue", lambda: page.locator("tbody tr").nth(1).wait_for())
    shoot("rig", "rig", lambda: page.locator("#checks").wait_for(), TALL)


def take_camera(page: Page, url: str, folder: Path) -> None:
    """Takes the picture of the live image of a lit room."""
    page.set_viewport_size({"width": SIZE["width"], "height": SIZE["height"]})
    page.goto(f"{url}/#/preview")
    page.locator("preview-figures .histogram rect").nth(63).wait_for(state="attached")
    page.wait_for_timeout(1_500)
    save(page, "camera", folder)


def take_calibration(page: Page, url: str, cell: Cell, client: Client, folder: Path) -> None:
    """Takes the pictures of the camera, and of a calibration that has an estimate and goes on."""
    take_camera(page, url, folder)
    cell.place("charuco@flange")
    client.wait_ready()
    client.state_tool("board")
    session = client.create(BoardRecipe(kind="hand-eye", max_images=20, target_mm=0.05))
    client.start(session.id)
    page.set_viewport_size({"width": SIZE["width"], "height": CALIBRATION_HEIGHT})
    page.goto(f"{url}/#/sessions/{session.id}")
    while not all(page.locator(one).count() for one in ("[data-view]", "svg.view", "#target-found[data-seen=true]")):
        if client.session(session.id).state is State.INTERRUPTED:
            client.resume(session.id)
        page.wait_for_timeout(200)
    save(page, "calibration", folder)
    client.stop(session.id)


def photograph(profile: str, address: str, take_pictures: Callable[[Page, str, Cell, Client], None]) -> None:
    """Runs a cell of a profile, its service and a browser, and takes pictures of them."""
    with (
        tempfile.TemporaryDirectory() as name,
        Cell(CellOptions(address, "figure", 1, profile, 4.0, pixels=512), Path(name) / "cell") as cell,
        serving(cell, Path(name) / "data") as service,
        Client(service.url) as client,
        sync_playwright() as playwright,
    ):
        client.wait_ready(600)
        context = chromium.launch(playwright).new_context(viewport=SIZE, locale="en-GB")  # type: ignore[arg-type]
        context.set_default_timeout(600_000)
        page = chromium.open_page(context, Console(), f"{service.url}/#/start")
        take_pictures(page, service.url, cell, client)
        context.close()


def main() -> None:
    """Takes the pictures into `docs/pictures`, or into the folder that is given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=PICTURES)
    parser.add_argument("--only", choices=("session", "calibration"), help="the pictures of one of them alone")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    if given.only != "calibration":
        photograph("direct", ADDRESS, lambda page, url, _, client: take(page, url, client, given.folder))
    if given.only != "session":  # a board is lit by the room
        photograph("realistic", ADDRESS, lambda *made: take_calibration(*made, given.folder))


if __name__ == "__main__":
    main()
