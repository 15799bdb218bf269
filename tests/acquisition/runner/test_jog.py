"""Jogging through the runner and the simulated controller: while the button is held, and not after."""

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.problem_table import PROBLEMS
from acquisition.runner import operator_moves
from acquisition.runner.operator_moves import HOLD_S, HoldToken, OperatorMoves
from acquisition.runner.runner import Runner
from acquisition.store import Store
from acquisition.waypoints.jog_step import JOG_SPEED_RAD_S
from api.rest import settings, wiring
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient

ADDRESS = "127.0.13.24"
CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"
PRESSES = count()
LAST = JogMotion(joint=5, direction=1)
BACK = JogMotion(joint=5, direction=-1)


@dataclass(frozen=True)
class Rig:
    runner: Runner
    store: Store
    home: tuple[float, ...]

    @property
    def joints(self) -> tuple[float, ...]:
        return self.runner.status().reading.joints

    def at_rest(self) -> tuple[float, ...]:
        """Joints once no jog goes on (between two of its steps the arm rests, too) and the arm does not move."""
        jog = self.runner.moves._jog
        self.until(lambda: jog is None or jog.ended.is_set())
        self.until(lambda: max(map(abs, self.runner.status().reading.joint_speeds)) < 1e-4)
        return self.joints

    def until(self, wanted: Callable[[], Any]) -> None:
        deadline = time.monotonic() + 60
        while not wanted():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def jog(self, hold: str, motion: JogMotion = LAST, *, once: bool = False) -> bool:
        return self.runner.moves.jog(hold, motion, "a", once=once)

    def ends(self) -> list[str]:
        """Outcomes of the jogs so far."""
        return [event.body["outcome"] for event in self.store.journal.events(0, types=("rig.jogged",))]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig]:
    folder = tmp_path_factory.mktemp("jog")
    with Cell(CellOptions(ADDRESS, "sphere", 1, "ideal", 1.0, pixels=64, cell_file=CELL_FILE), folder / "cell") as cell:
        service = wiring.build(settings.read(cell=cell.cell_file, data=folder / "data"))
        service.open()
        made = Rig(service.runner, service.store, service.cell.arm.home)
        ready(made)
        yield made
        service.close()


def ready(rig: Rig) -> None:
    """Waits until the arm may move; a link that the busy machine has interrupted is acknowledged, as a person does."""

    def clear() -> bool:
        with suppress(RigError):  # refused as long as the link is away
            rig.runner.acknowledge("a")
        return rig.runner.status().may_start

    rig.until(clear)


@contextmanager
def pressed(rig: Rig, motion: JogMotion) -> Generator[list[RigError]]:
    """A button that is held: requests with one `hold` until the block ends, and what they were refused with."""
    released, hold, refusals = threading.Event(), f"press-{next(PRESSES):05}", list[RigError]()

    def hold_down() -> None:
        while not released.is_set():
            try:
                rig.jog(hold, motion)
            except RigError as error:
                refusals.append(error)
                return
            time.sleep(0.05)

    threads = [threading.Thread(target=hold_down) for _ in range(2)]  # the first request waits for the arm
    for thread in threads:
        thread.start()
    try:
        yield refusals
    finally:
        released.set()
        for thread in threads:
            thread.join(60)


def refusal(request: Callable[[], object]) -> ErrorCode | None:
    """Code of the error that a request raises; none where it is taken."""
    try:
        request()
    except RigError as error:
        return error.code
    return None


def moved(rig: Rig, motion: JogMotion, radians: float) -> list[RigError]:
    """Holds the button until joint 5 has moved so far; presses again where a busy machine let the hold run out."""
    begun, refusals = rig.joints[5], list[RigError]()
    deadline = time.monotonic() + 60
    while abs(rig.joints[5] - begun) < radians:
        assert time.monotonic() < deadline, refusals
        ready(rig)
        with pressed(rig, motion) as refusals:
            while not refusals and abs(rig.joints[5] - begun) < radians:
                time.sleep(0.005)
    return refusals


@pytest.mark.long
def test_jog_held_moves_one_joint_over_several_steps(rig: Rig) -> None:
    before = rig.at_rest()
    moved(rig, LAST, 0.25)  # more than two steps
    after = rig.at_rest()

    turn = [two - one for one, two in zip(before, after, strict=True)]
    assert turn[5] >= 0.25
    assert max(map(abs, turn[:5])) < 2e-3
    moved(rig, BACK, 0.25)


def test_jog_released_ends_within_its_hold(rig: Rig) -> None:
    moved(rig, LAST, 0.05)
    at_release = rig.joints[5]
    at_rest = rig.at_rest()[5]
    time.sleep(2 * HOLD_S)

    # What it may turn at its speed until the hold has run out and it has braked.
    assert at_rest - at_release <= JOG_SPEED_RAD_S * (HOLD_S + 0.25)
    assert rig.joints[5] == pytest.approx(at_rest, abs=1e-3)
    moved(rig, BACK, 0.05)


def test_jog_release_ends_at_once(rig: Rig) -> None:
    with pressed(rig, LAST) as refusals:
        rig.until(lambda: refusals or max(map(abs, rig.runner.status().reading.joint_speeds)) > 0.01)
        rig.runner.moves.release()
        assert rig.runner.moves._jog is not None
        assert rig.runner.moves._jog.ended.is_set()
    rest = rig.at_rest()
    time.sleep(2 * HOLD_S)
    assert rig.joints == pytest.approx(rest, abs=1e-3)
    rig.runner.moves.release()  # harmless without a jog
    ready(rig)


def test_jog_lets_preview_see_between_steps(rig: Rig) -> None:
    ready(rig)
    begun = rig.joints[5]
    with pressed(rig, BACK) as refusals:
        rig.until(lambda: refusals or abs(rig.joints[5] - begun) > 0.02)
        frame = rig.runner.preview.take_frame(0.01)
    assert frame.pixels.shape == (64, 64)
    rig.at_rest()


def test_jog_once_is_one_exact_step(rig: Rig) -> None:
    for _ in range(5):
        ready(rig)
        before = rig.at_rest()
        rig.jog(f"press-{next(PRESSES):05}", JogMotion(joint=5, direction=1, step_rad=0.005), once=True)
        after = rig.at_rest()
        if rig.ends()[-1] == "one step":
            break
    assert after[5] - before[5] == pytest.approx(0.005, abs=1.5e-3)


def test_jog_in_local_control_moves_nothing(rig: Rig) -> None:
    """Somebody works at the pendant, and the second halt path is not obeyed; the control program still runs."""
    ready(rig)
    before = rig.at_rest()
    with ControlClient(ADDRESS) as control:
        control.fault("local_mode")
        try:
            with pytest.raises(RigError, match="local control") as refused:
                rig.jog(f"press-{next(PRESSES):05}", once=True)
        finally:
            control.fault("remote_mode")
    assert refused.value.code is ErrorCode.ARM_PREFLIGHT
    assert rig.joints == pytest.approx(before, abs=1e-3)


def test_jog_halt_ends_motion_and_its_hold(rig: Rig) -> None:
    hold = f"press-{next(PRESSES):05}"
    ready(rig)
    rig.jog(hold)
    rig.runner.halt("somebody")
    rig.until(lambda: rig.runner.moves._jog is None or rig.runner.moves._jog.ended.is_set())
    rest = rig.at_rest()

    for _ in range(3):  # the button is still held
        with pytest.raises(RigError) as refused:
            rig.jog(hold)
        assert refused.value.code in (ErrorCode.ARM_JOG_ENDED, ErrorCode.SAFETY_NOT_ACKNOWLEDGED)
    time.sleep(HOLD_S)
    assert rig.joints == pytest.approx(rest, abs=1e-3)


def test_jog_of_another_person_is_refused(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_moves, "HOLD_S", 3.0)  # renewals come late where other tests take both cores
    codes = list[ErrorCode | None]()
    deadline = time.monotonic() + 60
    while not codes:  # once more where a busy machine let the hold run out meanwhile
        assert time.monotonic() < deadline
        rig.at_rest()  # a jog of the other person that was taken last time refuses this one for as long as it lasts
        ready(rig)
        with pressed(rig, LAST) as refusals:
            rig.until(lambda: refusals or (rig.runner.moves._jog is not None and rig.runner.moves._jog.moving))
            jog = rig.runner.moves._jog
            asked = [refusal(lambda: rig.runner.moves.jog(f"other-{next(PRESSES):05}", LAST, "b", once=False))]
            asked.append(refusal(lambda: rig.runner.moves.park("b")))
            if jog is not None and not jog.ended.is_set():
                codes = asked
    assert codes == [ErrorCode.RIG_BUSY, ErrorCode.RIG_BUSY]


def test_jog_that_does_not_end_in_time_names_what_to_do() -> None:
    jog = operator_moves._Jog("press-0", LAST, "a", once=False)
    jog.ended.wait = lambda timeout=None: False  # its step is still under way
    moves = OperatorMoves.__new__(OperatorMoves)
    with pytest.raises(RigError, match="wait a moment, then ask again") as refused:
        moves._end(jog)
    assert "if not, do what the detail says" in PROBLEMS[refused.value.code].remedy  # no session holds the rig
    assert jog.token.is_set()


def test_hold_token_runs_out_and_is_not_revived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_moves, "HOLD_S", 30.0)
    token = HoldToken()
    assert not token.is_set()
    monkeypatch.setattr(operator_moves, "HOLD_S", -1.0)
    token.renew()
    assert token.is_set()
    monkeypatch.setattr(operator_moves, "HOLD_S", 30.0)
    token.renew()
    assert token.is_set()
    assert not token.halted
    other = HoldToken()
    other.set()
    assert other.is_set()
    assert other.halted


def test_jog_behind_another_ones_job_ends_with_its_hold(rig: Rig) -> None:
    """Somebody has asked for the reach, which takes a minute: neither the button nor a stop waits for it."""
    ready(rig)
    before, hold = rig.at_rest(), f"press-{next(PRESSES):05}"
    with rig.runner._compute._busy:
        began = time.monotonic()
        assert not rig.jog(hold)
        rig.runner.moves.release(hold)
        assert time.monotonic() - began < 30  # on a busy machine; without an end of the wait, never
    assert rig.at_rest() == pytest.approx(before, abs=2e-3)
    assert refusal(lambda: rig.jog(hold)) is ErrorCode.ARM_JOG_ENDED
