"""The real service beside a simulated cell: generated requests of all phases, hostile inputs, a probe all the while.

    pytest -m long -s tests/contract

prints the figures. `LIGHTPOSE_CASES` sets the number of cases for each operation and phase. The service runs in a
process of its own as a user starts it, with an admin's key, so that every route is open; the arm of the simulated cell
moves as the requests ask. What counts: no fault (5xx) but those that the description declares for the route, and each
of them with Retry-After where it is a 503; no hang; and `/health/live` answers at once throughout.
"""

import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client
from api.rest import keys
from api.rest.app import description
from hardware_sim.cell import Cell, CellOptions
from tests.contract import generated_requests, hostile_requests
from tests.contract.hostile_requests import Outcome
from tests.end_to_end.processes import serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(7200)]

ROOT = Path(__file__).parents[2]
CASES = int(os.environ.get("LIGHTPOSE_CASES", "30"))
LIVE_P99_MS = 100.0
"""Time within which 99 % of the probes have to be answered, ms, whatever else the machine does."""


@dataclass
class Contract:
    """A service with a completed session, and what its probe has measured once `ended`."""

    url: str
    key: str
    session_id: str
    live: dict[str, float] = field(default_factory=dict[str, float])


@contextmanager
def probed(url: str, measured: dict[str, float]) -> Generator[None]:
    """Asks whether the service lives, from a process of its own, all the while."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.contract.liveness", url],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.readline()
    try:
        yield
    finally:
        said, _ = process.communicate("", timeout=120)
        measured.update(json.loads(said))


@pytest.fixture(scope="module")
def contract(tmp_path_factory: pytest.TempPathFactory) -> Generator[Contract]:
    folder = tmp_path_factory.mktemp("contract")
    data = folder / "data"
    data.mkdir(mode=0o700)
    key = keys.add(keys.path_in(data), "admin", keys.Role.ADMIN)
    cell_file = ROOT / "tests" / "data" / "cell.test.toml"
    begun = time.monotonic()

    def tell(what: str) -> None:
        print(f"  {time.monotonic() - begun:4.0f} s {what}", flush=True)

    options = CellOptions("127.0.47.1", "sphere", 1, "ideal", 20.0, pixels=96, cell_file=cell_file)
    with Cell(options, folder / "cell") as cell, serving(cell, data) as service, Client(service.url, key) as client:
        client.wait_ready(180)
        tell("the rig is ready; a session, which compiles what a checkout has not compiled yet")
        session = client.create(Recipe(pilot_lights=3, planned_lights=1, label="known"))
        client.start(session.id)
        while client.wait(session.id).state is State.INTERRUPTED:  # a busy machine
            client.resume(session.id)
        assert client.session(session.id).state is State.COMPLETED
        tell("reach, dry run, jog")
        warm(service.url, key)
        tell("the requests begin")
        yield Contract(service.url, key, session.id)


def warm(url: str, key: str) -> None:
    """Has made what is made once for a cell and a checkout: the map of the reach, kernels, the roadmap of a jog."""
    with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {key}"}, timeout=900, trust_env=False) as http:
        assert http.get("/v1/rig/reach").status_code == 200
        assert http.get("/v1/rig/reach.html").status_code == 200
        assert http.post("/v1/dry-runs", json={}).status_code == 200
        assert http.post("/v1/rig/jog", json={"hold": "warming-up", "joint": 5, "direction": 1}).status_code == 202
        assert http.post("/v1/rig/jog/release").status_code == 202


def test_generated_requests_of_all_phases_find_no_fault(contract: Contract, tmp_path: Path) -> None:
    known: dict[str, Any] = {
        "session_id": contract.session_id, "number": 0, "shot_number": 0, "light": 0, "artefact": "manifest.json",
        "form": "png", "code": "rig.busy",
    }  # fmt: skip
    with probed(contract.url, contract.live):
        run = generated_requests.run(contract.url, contract.key, known, tmp_path, CASES)

    print(f"\n{run.table()}\n{run.links}\nlive: {contract.live}")
    print(f"undeclared faults: {run.undeclared(description())}\nhangs: {run.hangs}\nfailures: {run.failures}")
    assert {item["phase"] for item in run.answers} == set(generated_requests.PHASES), run.output
    assert run.undeclared(description()) == []
    assert [item for item in run.faults if item["status"] == 503 and item["retry_after"] is None] == []
    assert run.hangs == []
    assert run.failures == [], run.output
    assert_live(contract.live)


def test_hostile_inputs_are_all_answered(contract: Contract) -> None:
    target = urlsplit(contract.url)
    inputs = hostile_requests.inputs(description(), contract.session_id, contract.key)
    measured: dict[str, float] = {}
    with probed(contract.url, measured):
        outcomes = hostile_requests.send_all(inputs, str(target.hostname), int(target.port or 0))

    statuses = Counter("cut" if item.status is None else item.status for item in outcomes)
    slowest = max(item.seconds for item in outcomes)
    print(f"\n{len(outcomes)} hostile inputs: {dict(statuses)}, slowest {slowest:.1f} s\nlive: {measured}")
    assert len(outcomes) == hostile_requests.COUNT
    assert [complaint for item in outcomes if (complaint := wrong(item))] == []
    assert_live(measured)
    header = {"Authorization": f"Bearer {contract.key}"}
    assert httpx.get(f"{contract.url}/v1/rig", headers=header, timeout=60, trust_env=False).status_code == 200


def assert_live(measured: dict[str, float]) -> None:
    """Every probe was answered, 99 % of them in time; `measured` tells how late the machine made the probe itself."""
    assert measured["bad"] == 0
    assert measured["p99_ms"] <= LIVE_P99_MS, measured


def wrong(outcome: Outcome) -> str | None:
    """What is wrong with what became of an input; None: nothing."""
    said = f"{outcome.hostile.name}: {outcome.status} after {outcome.seconds:.1f} s, {outcome.body[:200]!r}"
    if outcome.hung or (outcome.status is not None and outcome.status >= 500):
        return said
    if outcome.status is None:
        return said if outcome.hostile.whole else None
    headless = outcome.hostile.name.startswith(("HEAD", "TRACE"))
    if outcome.status >= 400 and not headless and hostile_requests.problem_code(outcome.body) is None:
        return f"{said} is no problem object"
    return None
