"""Memory of the operator's page over time: `python -m tests.api.page.measure --memory MINUTES`.

One page stays open while events and sessions come in, and goes through all screens once a minute; back on the cell's
screen its heap is read after forced collections of garbage, with the document's nodes and listeners, the heap of the
shared worker that holds the event stream, and the service's resident memory. `objects_mb` is the page's heap without
the code that V8 compiles: it compiles more of it, and better, the longer a page runs, up to all that there is. What the
page keeps a limited number of (events, sessions) is filled up before the first sample, so that only what grows without
end can make a slope. It is fitted by least squares; its standard error is enlarged for the correlation of neighbouring
samples (Santer et al., 2000: n (1 − r)/(1 + r) independent ones). What has grown most is told by constructor, so that a
slope leads to its cause.
"""

import json
import statistics
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
import numpy.typing as npt
from playwright.sync_api import Browser, Page

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client
from tests.api.page.chromium import Console, open_page
from tests.end_to_end.processes import Service

SAMPLE_S = 60.0
"""Time between two samples, s."""

SESSION_EVERY = 2
"""A session is run before every so many samples: the load on a machine that others use stays low."""

WARM_UP = 6
"""Times that the page goes through all screens before the first sample."""

EDITS = 12
"""Edits of a session's notes between two samples: each is an event."""

KEPT_EVENTS = 400
KEPT_SESSIONS = 20
"""Events and sessions that the page keeps (`connection/live.ts`)."""

SCREEN_MS = 700
"""Time on each screen, ms: what it shows has been read by then, or the next screen gives the reading up."""

SCREENS = ("start", "preview", "sessions", "queue", "rig", "calibration")
PARTS = ("", "/plan", "/result")
TOLD = 12
"""Constructors whose growth is told."""

EXCLUDED = frozenset({"code", "native"})
NAMED = frozenset({"object", "closure", "array", "hidden", "object shape"})
"""Kinds of a heap snapshot's nodes that are not counted, and those that are told apart by name."""

JUDGED = ("objects_mb", "worker_mb", "nodes", "listeners")
"""Figures that must not grow."""

PATIENCE_MS = 300_000
"""How long the page is waited for on a busy machine, ms."""

QUICK = Recipe(pilot_lights=3, planned_lights=0, label="memory")


@dataclass(frozen=True)
class Sample:
    """What is in use at a time: minutes since the first sample, MB, numbers."""

    minute: float
    heap_mb: float
    objects_mb: float
    worker_mb: float
    nodes: float
    listeners: float
    service_mb: float


@dataclass(frozen=True)
class Slope:
    """Growth per hour with its standard error."""

    per_hour: float
    error: float

    @property
    def is_flat(self) -> bool:
        """Whether the growth is not more than chance gives: within two standard errors of none, or none."""
        return self.per_hour <= 2 * self.error


def slope_of(minutes: npt.NDArray[np.float64], values: npt.NDArray[np.float64]) -> Slope:
    """Fits a line by least squares (at least four samples); the error allows for correlated neighbours."""
    hours = (minutes - minutes.mean()) / 60
    per_hour = float(hours @ values / (hours @ hours))
    residual = values - values.mean() - per_hour * hours
    power = float(residual @ residual)
    if power == 0:
        return Slope(per_hour, 0.0)
    correlation = max(0.0, float(residual[1:] @ residual[:-1]) / power)
    independent = max(len(values) * (1 - correlation) / (1 + correlation), 3.0)
    return Slope(per_hour, float(np.sqrt(power / (independent - 2) / (hours @ hours))))


class WorkerHeap:
    """The heap of a browser's shared worker, by the debugging protocol."""

    def __init__(self, browser: Browser) -> None:
        self._session = browser.new_browser_cdp_session()
        self._answers: list[dict[str, float]] = []
        self._session.on("Target.receivedMessageFromTarget", self._hear)
        targets = self._session.send("Target.getTargets")["targetInfos"]
        worker = next(target["targetId"] for target in targets if target["type"] == "shared_worker")
        attached = self._session.send("Target.attachToTarget", {"targetId": worker, "flatten": False})
        self._id = attached["sessionId"]

    def mb(self) -> float:
        """The heap after a collection of garbage, MB."""
        self._ask("HeapProfiler.collectGarbage")
        return self._ask("Runtime.getHeapUsage")["usedSize"] / 1e6

    def _ask(self, method: str) -> dict[str, float]:
        expected = len(self._answers) + 1
        message = json.dumps({"id": expected, "method": method})
        self._session.send("Target.sendMessageToTarget", {"sessionId": self._id, "message": message})
        while len(self._answers) < expected:
            self._session.send("Target.getTargets")  # lets the answer in
        return self._answers[-1]

    def _hear(self, event: dict[str, str]) -> None:
        answer = json.loads(event["message"])
        if "id" in answer:
            self._answers.append(answer["result"])


def heap_of(page: Page) -> dict[str, float]:
    """Metrics of a page by Chromium's names, after two collections of garbage: the first one queues finalisers."""
    session = page.context.new_cdp_session(page)
    for _ in range(2):
        session.send("HeapProfiler.collectGarbage")
    session.send("Performance.enable")
    metrics = {item["name"]: float(item["value"]) for item in session.send("Performance.getMetrics")["metrics"]}
    session.detach()
    return metrics


def sizes_by_constructor(page: Page) -> Counter[str]:
    """Bytes of all that a page's heap holds but compiled code and what the browser itself keeps.

    Objects and closures count by their constructor's or function's name, strings and the like by what they are.
    """
    session = page.context.new_cdp_session(page)
    parts: list[str] = []

    def take(event: dict[str, str]) -> None:
        parts.append(event["chunk"])

    session.on("HeapProfiler.addHeapSnapshotChunk", take)
    session.send("HeapProfiler.takeHeapSnapshot", {"reportProgress": False})
    session.detach()
    snapshot = json.loads("".join(parts))
    meta = snapshot["snapshot"]["meta"]
    nodes = np.array(snapshot["nodes"]).reshape(-1, len(meta["node_fields"]))
    kinds: list[str] = meta["node_types"][0]
    sizes: Counter[str] = Counter()
    columns = (meta["node_fields"].index(name) for name in ("type", "name", "self_size"))
    for kind, name, size in nodes[:, list(columns)].tolist():
        if kinds[kind] not in EXCLUDED:
            named = kinds[kind] in NAMED
            constructor = snapshot["strings"][name].split("@")[0]  # scopes are named by an address that changes
            sizes[f"{kinds[kind]} {constructor}" if named else kinds[kind]] += size
    return sizes


def resident_mb(process: int) -> float:
    """A process's resident memory, MB."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return float(line.split()[1]) / 1e3


def tour(page: Page, url: str, session_id: str) -> None:
    """Goes through all screens, and back to the cell's."""
    for place in (*SCREENS, *(f"sessions/{session_id}{part}" for part in PARTS)):
        page.goto(f"{url}/#/{place}")
        page.locator("main h1").wait_for()
        if place == "calibration":
            page.locator("#kinds input").first.check()  # the board is looked for in live images then
        page.wait_for_timeout(SCREEN_MS)
    page.goto(f"{url}/#/cell")
    page.locator("#cell[data-frames]").wait_for()


def fill(page: Page, url: str, client: Client, run: Callable[[Client, Recipe, State], str]) -> str:
    """Fills what the page keeps a limited number of, with sessions that have results; returns the last of them."""
    session_id = ""
    for _ in range(KEPT_SESSIONS):
        session_id = run(client, QUICK, State.COMPLETED)
        page.goto(f"{url}/#/sessions/{session_id}")
        page.locator(".images img").first.wait_for()
    while page.evaluate("window.lightpose.events.length") < KEPT_EVENTS:
        client.edit(session_id, notes="one more event")
    return session_id


def measure_memory(
    browser: Browser, service: Service, client: Client, minutes: float, run: Callable[[Client, Recipe, State], str]
) -> None:
    """Prints a sample a minute, then the fits; exits with an error where the page's memory grows."""
    page = open_page(browser.new_context(), Console(), f"{service.url}/#/cell")
    page.set_default_timeout(PATIENCE_MS)
    edited = shown = fill(page, service.url, client, run)
    for _ in range(WARM_UP):
        tour(page, service.url, shown)
    worker = WorkerHeap(browser)
    names = [field.name for field in fields(Sample)]
    print(*names, "sessions", sep="\t", flush=True)
    samples: list[Sample] = []
    sizes: list[Counter[str]] = []
    sessions = KEPT_SESSIONS
    begun = time.monotonic()
    while not samples or samples[-1].minute < minutes:
        due = begun + SAMPLE_S * len(samples)
        if samples and len(samples) % SESSION_EVERY == 0:
            shown = run(client, QUICK, State.COMPLETED)
            sessions += 1
        for number in range(EDITS):
            client.edit(edited, notes=f"sample {len(samples)}, edit {number}")
        tour(page, service.url, shown)
        page.wait_for_timeout(max(2_000.0, 1e3 * (due - time.monotonic())))
        metrics = heap_of(page)
        sizes.append(sizes_by_constructor(page))
        sample = Sample(
            minute=(time.monotonic() - begun) / 60,
            heap_mb=metrics["JSHeapUsedSize"] / 1e6,
            objects_mb=sizes[-1].total() / 1e6,
            worker_mb=worker.mb(),
            nodes=metrics["Nodes"],
            listeners=metrics["JSEventListeners"],
            service_mb=resident_mb(service.process.pid),
        )
        samples.append(sample)
        print(*(f"{value:.2f}" for value in astuple(sample)), sessions, sep="\t", flush=True)
    tell_growth(sizes)
    report(samples)


def tell_growth(sizes: list[Counter[str]]) -> None:
    """Prints what has grown most from the first to the last third of the samples, by constructor, in kB on average."""
    third = max(1, len(sizes) // 3)
    growth: Counter[str] = Counter()
    for taken, sign in ((sizes[-third:], 1), (sizes[:third], -1)):
        for one in taken:
            for name, size in one.items():
                growth[name] += sign * size
    for name, size in growth.most_common(TOLD):
        print(f"{size / third / 1e3:+.2f} kB {name}")


def report(samples: list[Sample]) -> None:
    """Prints the growth of each figure. Raises SystemExit where the page's or its worker's heap grows."""
    columns = np.array([astuple(sample) for sample in samples]).T
    growing: list[str] = []
    for name, values in zip([field.name for field in fields(Sample)][1:], columns[1:], strict=True):
        slope = slope_of(columns[0], values)
        print(f"{name}: median {statistics.median(values):.2f}, {slope.per_hour:+.3f} ± {slope.error:.3f} an hour")
        if not slope.is_flat and name in JUDGED:
            growing.append(name)
    if growing:
        raise SystemExit(f"the page's memory grows: {', '.join(growing)}")
