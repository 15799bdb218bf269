"""A simulated cell that outlives its services, an undisturbed session, and what must equal it after a crash."""

import json
import os
import random
import shutil
import subprocess
import time
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.session import FIRST_FURTHER_NUMBER, FIRST_REFERENCE_NUMBER
from acquisition.session_state import State
from acquisition.store import Journal
from api import Client, ProblemError
from api.rest.schemas import EventResource, SessionResource
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.end_to_end.processes import Service, fastest_joint, rests_after, serving

RECIPE = Recipe(pilot_lights=3, planned_lights=1)
CELL_FILE = Path(__file__).parents[2] / "tests" / "data" / "cell.test.toml"
PIXELS, SPEED = 128, 20.0
MOST_RESUMES = 6
PLACE_M, NORMALS_DEG, SHARE = 1e-6, 0.01, 0.999


def cases(name: str, count: int) -> list[int]:
    """Numbers of cases: all `count`, or those that the variable `name` gives as `start:stop`."""
    first, _, last = os.environ.get(name, f"0:{count}").partition(":")
    return list(range(int(first), int(last)))


@dataclass
class Bench:
    """The cell, its data folder, and the service that runs at present."""

    cell: Cell
    data: Path
    control: ControlClient
    record: Path | None = None
    environment: Mapping[str, str] = field(default_factory=dict[str, str])
    recipe: Recipe = RECIPE
    undisturbed: "Course | None" = None
    service: Service | None = None
    _services: ExitStack = field(default_factory=ExitStack)

    def serve(self) -> Client:
        """A client of a running service, which is started unless one lives."""
        if self.service is None or self.service.process.poll() is not None:
            self.service = self._services.enter_context(serving(self.cell, self.data, self.environment))
        return Client(self.service.url)

    def kill(self) -> None:
        """SIGKILL; the next `serve` starts another service."""
        assert self.service is not None
        self.service.kill()
        self.service = None

    def close(self) -> None:
        """Ends the service in good order."""
        self._services.close()

    def start(self, client: Client) -> str:
        """Starts a session from home, after ending what a case before has left behind; returns its id."""
        self.make_ready(client)
        return self.start_from_home(client)

    def make_ready(self, client: Client) -> None:
        """Puts the arm home by hand and ends what a case before has left behind."""
        if self.control.state()["joints"] != pytest.approx(self.cell.config.arm.home, abs=1e-3):
            self.control.fault("hand_move", joints=list(self.cell.config.arm.home), seconds=0)  # which stops the arm
        self._wait_ready(client)

    def start_from_home(self, client: Client) -> str:
        """Starts a session in a cell that is ready; returns its id."""
        session_id = client.create(self.recipe).id
        for attempt in range(3):  # a machine that is too busy refuses for good reasons; a person tries again
            try:
                client.start(session_id)
            except ProblemError:
                if attempt == 2:
                    raise
                self._wait_ready(client)
            else:
                break
        return session_id

    @property
    def stage_begins(self) -> list[float]:
        """When each stage of the undisturbed session began, and when it was over; s."""
        assert self.undisturbed is not None
        return [*self.undisturbed.stages, self.undisturbed.seconds]

    def run_into(self, client: Client, number: int, chance: random.Random) -> str:
        """Starts a session and lets it run to a random moment of its stage `number`; returns its id."""
        begins = self.stage_begins
        delay_s = chance.uniform(0.0, begins[number + 1] - begins[number])
        session_id = self.start(client)
        wait_for_stage(client, session_id, number)
        time.sleep(delay_s)
        return session_id

    def _wait_ready(self, client: Client) -> None:
        deadline = time.monotonic() + 60
        while not (rig := client.rig()).may_start:
            assert time.monotonic() < deadline, rig.reasons
            self.control.fault("clear")
            with suppress(ProblemError):
                if rig.holder is not None:
                    client.stop(rig.holder)
                if rig.faults:
                    client.acknowledge()
            time.sleep(0.2)


@contextmanager
def small_disk(data: Path, size_mb: int = 256) -> Generator[None, None, None]:
    """A file system of its own at `data`, which a test can fill up. Raises OSError where none may be mounted."""
    data.mkdir(parents=True)
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "lightpose-test", str(data)],
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        raise OSError("this process may not mount a file system")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(data)], check=True)


def fill(data: Path, leave: int) -> Path:
    """Leaves so many bytes free; returns the file that takes the others."""
    filler = data / "filler"
    with filler.open("wb") as file:
        while (size := shutil.disk_usage(data).free - leave) > 0:
            try:
                file.write(b"\0" * min(size, 1 << 20))
                file.flush()
            except OSError:
                break
    return filler


@dataclass(frozen=True)
class Course:
    """Course of an undisturbed session: when each stage began, s since the start request."""

    session_id: str
    stages: list[float]
    seconds: float


@contextmanager
def bench(
    folder: Path,
    address: str,
    data: Path | None = None,
    record: Path | None = None,
    environment: Mapping[str, str] = {},
    speed: float = SPEED,
    recipe: Recipe = RECIPE,
) -> Generator[Bench, None, None]:
    """A cell and its undisturbed session; `record` receives the controller's ticks."""
    with (
        Cell(
            CellOptions(address, "sphere", 1, "ideal", speed, pixels=PIXELS, cell_file=CELL_FILE, record=record),
            folder / "cell",
        ) as cell,
        ControlClient(address) as control,
    ):
        made = Bench(cell, data or folder / "data", control, record, environment, recipe)
        try:
            with made.serve() as client:
                undisturbed(made, client)  # the first one starts processes and makes the reach
                made.undisturbed = undisturbed(made, client)
            yield made
        finally:
            made.close()


def undisturbed(made: Bench, client: Client) -> Course:
    """Runs sessions until nothing, a busy machine included, has disturbed one."""
    for _ in range(MOST_RESUMES):
        begun = time.time()
        session_id = made.start(client)
        events: list[EventResource] = []
        done = client.wait(session_id, events.append)
        if done.state is State.COMPLETED:
            return course(session_id, events, begun)
    raise AssertionError(f"no session was left alone: {done.reason}")


def course(session_id: str, events: list[EventResource], begun: float) -> Course:
    """How a session went that was started at `begun`."""
    stages = [event.at.timestamp() - begun for event in events if event.type == "session.stage"]
    return Course(session_id, stages, time.time() - begun)


def wait_for_stage(client: Client, session_id: str, number: int) -> None:
    """Returns when the stage of this number in the session's course has begun, or the session waits or has ended."""
    begun = -1
    for event in client.events(session_id, after=0):
        begun += event.type == "session.stage"
        if begun >= number or (event.type == "session.state" and event.body["state"] != "running"):
            return


def wait_for_image(client: Client, session_id: str) -> None:
    """Returns when the session has an image, or waits or has ended."""
    for event in client.events(session_id, after=0):
        if event.type == "shot.captured" or (event.type == "session.state" and event.body["state"] != "running"):
            return


def announced(data: Path, session_id: str) -> dict[tuple[int, int], str]:
    """SHA-256 of the frames that a session's events announced, read directly from the database."""
    journal = Journal(data / "rig.db")
    try:
        announced_images = {
            (event.body["pass"], event.body["number"])
            for event in journal.events(0, 10_000, session_id, ("shot.captured",))
        }
        return {
            key: shot.frame.sha256
            for shot in journal.shots(session_id)
            if (key := (shot.key.pass_number, shot.key.number)) in announced_images
        }
    finally:
        journal.close()


def state_of(data: Path, session_id: str) -> State:
    """A session's state in the database as it is."""
    journal = Journal(data / "rig.db")
    try:
        return journal.session(session_id).state
    finally:
        journal.close()


def resume(made: Bench, client: Client, session_id: str) -> SessionResource:
    """Resumes until the session ends; a busy machine may interrupt it more than once."""
    for _ in range(MOST_RESUMES):
        deadline = time.monotonic() + 60
        while True:
            made.control.fault("clear")
            try:
                client.acknowledge()
                client.resume(session_id)
            except ProblemError as error:
                if time.monotonic() > deadline:
                    raise AssertionError(f"nobody may resume: {error}") from error
                time.sleep(0.3)
                continue
            break
        session = client.wait(session_id)
        if session.state is State.COMPLETED:
            return session
        assert session.state in (State.INTERRUPTED, State.PAUSED), session.reason
        assert_rests(made)
    raise AssertionError(f"resumed {MOST_RESUMES} times: {session.reason}")


def assert_rests(made: Bench, *, lamp_stuck: bool = False) -> None:
    """The arm rests; then nothing moves and the lamp stays dark, by the simulator's record, until somebody resumes."""
    come_to_rest(made)
    before = made.control.state()
    time.sleep(0.3)
    after = made.control.state()
    assert fastest_joint(made.control) < 1e-3
    assert after["moves_started"] == before["moves_started"]
    assert after["joints"] == pytest.approx(before["joints"], abs=1e-6)
    assert lamp_stuck or after["digital_outputs"] == 0


def come_to_rest(made: Bench) -> tuple[int, list[float]]:
    """Moves begun so far, and where the arm stands once it rests."""
    rests_after(made.control)
    state = made.control.state()
    return state["moves_started"], state["joints"]


def assert_equal_to_the_undisturbed(made: Bench, session: SessionResource, kept: dict[tuple[int, int], str]) -> None:
    """The session is complete, no frame was lost or taken twice, and the result is that of the undisturbed run."""
    assert made.undisturbed is not None
    assert session.state is State.COMPLETED, session.reason
    mine, other = (made.data / "sessions" / name for name in (session.id, made.undisturbed.session_id))
    shots, wanted = frames(mine), frames(other)
    assert sorted(shots) == sorted(wanted)
    assert {key: shots[key] for key in kept if key in shots} == {key: kept[key] for key in kept if key in shots}
    references = range(FIRST_REFERENCE_NUMBER, FIRST_FURTHER_NUMBER)  # repeated images have numbers of their own
    assert all(key in shots or key[1] in references for key in kept)
    on_disk = [
        path for path in mine.rglob("*.tiff")
        if path.parent.name in ("shots", "brackets") or path.name.startswith("dark_")
    ]  # fmt: skip
    assert len(on_disk) == len(wanted)
    for number in (0, 1):
        plans = [newest_plan(folder, number) for folder in (mine, other)]
        positions = [np.array([light.position for light in plan.lights]) for plan in plans]
        assert np.abs(positions[0] - positions[1]).max() <= PLACE_M
        assert share_within(mine / f"results/{number}", other / f"results/{number}") >= SHARE


def frames(folder: Path) -> dict[tuple[int, int], str]:
    """SHA-256 by pass and number of the images in a session's manifest, without repetitions."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    keys = [
        (shot["key"]["pass_number"], shot["key"]["number"]) for shot in manifest["shots"] if shot["kind"] != "reference"
    ]
    assert len(keys) == len(set(keys))
    return {
        (shot["key"]["pass_number"], shot["key"]["number"]): shot["frame"]["sha256"]
        for shot in manifest["shots"]
        if shot["kind"] != "reference"
    }


def newest_plan(folder: Path, number: int) -> LightPlan:
    """The plan of a pass that nobody has replaced."""
    return LightPlan.model_validate_json((folder / f"passes/{number}/plan.json").read_bytes())


def share_within(result: Path, other: Path) -> float:
    """The share of the pixels that either result has a normal for, whose normals differ by at most NORMALS_DEG."""
    normals = [tifffile.imread(folder / "normals.tiff").astype(np.float64) for folder in (result, other)]
    masks = [cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED) > 0 for folder in (result, other)]
    either, both = masks[0] | masks[1], masks[0] & masks[1]
    cross = np.linalg.norm(np.cross(normals[0], normals[1]), axis=-1)
    angle_deg = np.degrees(np.arctan2(cross, np.sum(normals[0] * normals[1], axis=-1)))
    return float(np.count_nonzero(both & (angle_deg <= NORMALS_DEG)) / np.count_nonzero(either))
