"""Figures of the operator's page: `python -m tests.api.page.measure`, with `--memory MINUTES` its memory over time.

First picture of the cell (median of five cold starts), pictures a second while the arm moves at life speed, and time
from a dragged light to its forecast; headless Chromium with WebGL in software, beside cell and service on the same
machine. `--memory` measures the growth of the page's memory instead (`tests.api.page.memory`).
"""

import argparse
import contextlib
import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client
from api.client.responses import ProblemError
from api.rest import page as bundle_files
from hardware_sim.cell import Cell, CellOptions
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.memory import measure_memory
from tests.end_to_end.processes import serving

ADDRESS = "127.0.49.210"
CELL_FILE = Path(__file__).parents[2] / "data" / "cell.test.toml"
STARTS = 5
READY_WITHIN_S = 600.0
"""How long the rig may take to be ready again after a busy machine has stopped it, s."""

WATCH_FRAMES = """
window.moved = {ms: 0, frames: 0};
let last = null;
setInterval(() => {
  const now = performance.now(), frames = Number(document.querySelector("#cell").dataset.frames);
  if (last && window.lightpose.joints?.moving) { moved.ms += now - last[0]; moved.frames += frames - last[1]; }
  last = [now, frames];
}, 100);
"""

WATCH_FORECASTS = """
window.delays = [];
let moved = null;
document.querySelector("dome-plot").addEventListener("light-moved", () => { moved ??= performance.now(); });
new MutationObserver(() => { if (moved !== null) { delays.push(performance.now() - moved); moved = null; } })
  .observe(document.querySelector("#sigma-forecast"), {characterData: true, childList: true, subtree: true});
"""


def first_picture_ms(browser: Browser, url: str) -> float:
    """Time from the start of a cold load to the cell's first picture, ms."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{url}/#/cell")
    page.locator("#cell[data-frames]").wait_for()
    taken = page.evaluate("performance.getEntriesByName('cell drawn')[0].startTime")
    context.close()
    return float(taken)


def run(client: Client, recipe: Recipe, until: State) -> str:
    """Runs a session to a state, resuming it where a busy machine has made the watchdog stop the arm."""
    if not client.safety().clear:
        client.acknowledge()
    client.wait_ready(READY_WITHIN_S)
    session_id = str(client.create(recipe).id)
    client.start(session_id)
    while (state := client.wait(session_id).state) is not until:
        if state is not State.INTERRUPTED:
            raise SystemExit(f"the session is {state}")
        if not client.safety().clear:
            client.acknowledge()
        with contextlib.suppress(ProblemError):  # the devices are being connected again
            client.resume(session_id)
    return session_id


def measure(browser: Browser, url: str, client: Client) -> None:
    """Prints the figures."""
    files = [file for name, file in bundle_files.bundle().items() if not name.endswith(".txt")]
    print(f"bundle: {sum(len(file.content) for file in files):,} bytes, "
          f"{sum(len(file.compressed) for file in files):,} compressed")  # fmt: skip
    starts = [first_picture_ms(browser, url) for _ in range(STARTS)]
    print(f"first picture of the cell: median {statistics.median(starts):.0f} ms of {sorted(map(round, starts))}")
    page = chromium.open_page(browser.new_context(), Console(), f"{url}/#/cell")
    page.locator("#cell[data-frames]").wait_for()
    page.evaluate(WATCH_FRAMES)
    review = run(client, Recipe(pilot_lights=4, planned_lights=3, review_plan=True), State.PAUSED)
    moved = page.evaluate("moved")
    seconds = moved["ms"] / 1e3
    print(f"pictures while the arm moves: {moved['frames'] / seconds:.1f} a second over {seconds:.1f} s")
    page.goto(f"{url}/#/sessions/{review}/plan")
    page.locator("#sigma-picture").wait_for()
    page.evaluate(WATCH_FORECASTS)
    box = page.locator(".dome .light[data-light='0'] circle").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    for step in range(40):
        page.mouse.move(box["x"] + 5 + 2 * step, box["y"] + 5 + step)
        page.wait_for_timeout(80)
    page.mouse.up()
    page.wait_for_timeout(1_000)
    delays = sorted(page.evaluate("delays"))
    middle = statistics.median(delays)
    print(f"forecast after a light moved: median {middle:.0f} ms, largest {delays[-1]:.0f} ms of {len(delays)}")


def main() -> None:
    """Measures at a cell at life speed; memory at one five times as fast, so that its sessions take little time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--memory", type=float, metavar="MINUTES", help="measure the growth of the page's memory")
    minutes: float | None = parser.parse_args().memory
    speed, pixels = (1.0, 256) if minutes is None else (5.0, 128)
    with (
        tempfile.TemporaryDirectory() as name,
        Cell(
            CellOptions(ADDRESS, "figure", 1, "direct", speed, pixels=pixels, cell_file=CELL_FILE), Path(name) / "cell"
        ) as cell,
        serving(cell, Path(name) / "data") as service,
        Client(service.url) as client,
        sync_playwright() as playwright,
    ):
        client.wait_ready(READY_WITHIN_S)
        browser = chromium.launch(playwright)
        if minutes is None:
            measure(browser, service.url, client)
        else:
            measure_memory(browser, service, client, minutes, run)
        browser.close()


if __name__ == "__main__":
    main()
