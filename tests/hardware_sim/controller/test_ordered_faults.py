"""Every fault that can be ordered, as the unmodified ur-rtde reports it; `OBSERVED_IN` lists the test of each.

Lamp, camera and object fail in the world: the library sees nothing of them.
"""

import re
from collections.abc import Iterator

import pytest

import hardware_sim.controller.faults as module
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.faults import FAULTS, FaultError, prepare
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import SafetyMode
from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, Cell, Client, fault_in_move, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

FAR = [HOME[0] + 2.5, *HOME[1:]]
SPEED, ACCELERATION = 1.05, 1.4
START = """
import threading
import rtde_control, rtde_io, rtde_receive
from hardware_sim.controller.control import ControlClient
address, far = sys.argv[1], [1.0, -1.9, 1.9, -1.57, -1.57, 0.0]
receive = rtde_receive.RTDEReceiveInterface(address)
control = rtde_control.RTDEControlInterface(address)
io = rtde_io.RTDEIOInterface(address)
faults = ControlClient(address)

def tell(*answers):
    print(*answers, flush=True)

def fault_in_move(kind, **parameters):
    def order():
        with ControlClient(address) as orders:
            while orders.state()["joint_speeds"][0] < 0.3:
                time.sleep(0.005)
            orders.fault(kind, **parameters)

    threading.Thread(target=order, daemon=True).start()
"""
OBSERVED_IN = {
    "test_failures": "protective_stop emergency_stop program_stop output_stuck joint_offset",
    "test_dashboard_client": "violation fault local_mode",
    "test_failing_links": "stall remote_mode",
    "test_conformance": "clear",
    "test_ordered_faults": """safeguard_stop release_safeguard_stop system_emergency_stop release_emergency_stop
        power_off program_pause speed_slider hand_move time_jump delay cut half_packet restart""",
    "the world": "lamp dropped_frame saturated_frame nudged_object",
}


class NoLinks:
    """Ports of a controller without any."""

    def numbers(self) -> list[int]:
        return []

    def cut(self, port: int) -> None:
        raise LookupError(port)

    def stall(self, port: int, seconds: float) -> None:
        raise LookupError(port)

    def __getattr__(self, name: str) -> object:
        raise LookupError(name)


def test_fault_at_s_takes_effect_after_that_time_of_the_ticks() -> None:
    """Stepped by hand: on a busy machine a tick sees the order and the clock later than the client does."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.tick(1.0)
    prepare(controller, NoLinks(), {"kind": "safeguard_stop", "at_s": 0.1})
    for now, mode in ((1.05, SafetyMode.NORMAL), (1.099, SafetyMode.NORMAL), (1.1, SafetyMode.SAFEGUARD_STOP)):
        controller.tick(now)
        assert controller.safety.safety_mode is mode, now


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"kind": "protective_stop", "at_mov": 2}, "protective_stop takes at_s, at_move, not at_mov"),
        (
            {"kind": "lamp", "fraktion": 0.0, "at_S": 1},
            "lamp takes fraction, flicker, at_s, at_move, not at_S, fraktion",
        ),
        (
            {"kind": "protective_stop", "at_s": 60, "at_move": 1},
            "give at_s or at_move, not both",
        ),
    ],
)
def test_fault_with_unknown_or_ambiguous_parameter_is_refused(fields: dict[str, object], said: str) -> None:
    """Ignored, a misspelt time would let the fault happen at once, and one of two times would not hold."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    with pytest.raises(FaultError, match=f"^{said}$"):
        prepare(controller, NoLinks(), {"command": "fault", **fields})
    assert controller.safety.safety_mode is SafetyMode.NORMAL


@pytest.mark.parametrize("kind", FAULTS)
def test_fault_takes_the_parameters_that_are_documented(kind: str) -> None:
    documented = re.search(rf"\b{kind} \{{(.+?)\}}", module.__doc__ or "")
    names = re.findall(r"(?:^|, )([a-z_]+)", re.sub(r":[^,]+|\[.*?\]", "", documented[1])) if documented else []
    assert set(FAULTS[kind].takes) == set(names)


@pytest.fixture
def cell(cell_cleared_afterwards: Cell) -> Cell:
    return cell_cleared_afterwards


@pytest.fixture(scope="module")
def controller() -> Iterator[ControllerProcess]:
    """One controller for clients that come and go."""
    with start() as process:
        yield process


def run(code: str, address: str) -> list[str]:
    client = Client(START + code + "\nos._exit(0)\n", address)
    return [line for line in client.finish() if "econnect" not in line]


@pytest.mark.parametrize("fault", ["cut", pytest.param("half_packet", marks=pytest.mark.long)])
def test_link_cut_in_move_reconnects_control(controller: ControllerProcess, fault: str) -> None:
    """The control client reconnects; its move says either, by chance, and the arm goes on.

    The receive client stays cut off. The IO client says that it is connected, and what it writes is lost.
    """
    lines = run(
        f"""
control.moveJ([0.0, *far[1:]], 3.0, 20.0)
io.setStandardDigitalOut(1, False)
fault_in_move("{fault}", **({{"port": 30004}} if "{fault}" == "cut" else {{}}))
tell(control.moveJ(far, 1.05, 1.4) in (True, False))
while faults.state()["joints"][0] != 1.0:
    time.sleep(0.01)
tell(control.isConnected(), receive.isConnected(), io.isConnected(), control.isProgramRunning())
tell(io.setStandardDigitalOut(1, True))
time.sleep(0.05)
tell(faults.state()["digital_outputs"])
""",
        controller.address,
    )
    lost = "0" if fault == "cut" else lines[-1]  # half a packet goes only to those who read packets
    assert lines == ["True", "True False True True", "True", lost]


@pytest.mark.long
def test_control_client_after_cut_serves_again(controller: ControllerProcess) -> None:
    """Its calls say False, or last seconds, until it has reconnected to the end and uploaded anew."""
    lines = run(
        """
faults.fault("cut", port=30004)
deadline = time.monotonic() + 60
while not control.moveJ(far, 3.0, 20.0) and time.monotonic() < deadline:
    time.sleep(0.1)
tell(time.monotonic() < deadline, control.isConnected(), faults.state()["joints"][0])
""",
        controller.address,
    )
    assert lines[-1] == "True True 1.0"


def test_script_port_cut_loses_next_upload(controller: ControllerProcess) -> None:
    """Commands go on working; the next upload says True and is lost with the program that it was to replace."""
    lines = run(
        """
faults.fault("cut", port=30003)
tell(control.moveJ([0.1, *far[1:]], 3.0, 20.0), control.reuploadScript())
while control.isProgramRunning():
    time.sleep(0.01)
tell(control.isProgramRunning(), control.moveJ(far, 3.0, 20.0))
""",
        controller.address,
    )
    assert lines == ["True True", "False False"]


def test_controller_restart_needs_new_clients() -> None:
    """All is cut and the arm without power; clients of before never come back by themselves."""
    with start() as process:
        lines = run_restart(process.address)
    assert lines == ["False", "False False False 1"]


def run_restart(address: str) -> list[str]:
    return run(
        """
faults.fault("restart", at_s=0.3)
tell(control.moveJ(far, 1.05, 1.4))
restarted = False
while not restarted:
    try:
        again = rtde_receive.RTDEReceiveInterface(address)
    except RuntimeError:
        time.sleep(0.05)
        continue
    # On a busy machine the restart can cut this new client too, which would then wait for a mode that never comes.
    while again.isConnected() and not restarted:
        restarted = again.getRobotMode() == 3
        time.sleep(0.01)
tell(control.isConnected(), receive.isConnected(), control.moveJ(far, 1.05, 1.4), again.getSafetyMode())
""",
        address,
    )


def test_faults_are_each_observed_in_a_test() -> None:
    assert set(" ".join(OBSERVED_IN.values()).split()) == set(FAULTS)


def test_safeguard_stop_pauses_and_play_resumes(cell: Cell) -> None:
    """A synchronous move says False, but after the release `play` goes on with it."""
    with cell.process.control() as faults:
        with fault_in_move(cell, "safeguard_stop"):
            assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        wait_until(lambda: cell.receive.getSafetyStatusBits() == 1 << 4 | 1 << 10)
        assert cell.receive.getSafetyMode() == 5
        assert not cell.receive.isProtectiveStopped()
        assert not cell.receive.isEmergencyStopped()
        assert cell.dashboard.programState() == "PAUSED rtde_control"
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
        stopped_at = cell.receive.getActualQ()[0]
        faults.fault("release_safeguard_stop")
    cell.dashboard.play()
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(FAR, abs=1e-6))
    assert HOME[0] < stopped_at < FAR[0]


def test_system_emergency_stop_sets_its_own_bits(cell: Cell) -> None:
    with cell.process.control() as faults:
        with fault_in_move(cell, "system_emergency_stop"):
            assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        wait_until(lambda: cell.receive.getSafetyStatusBits() == 1 << 5 | 1 << 7 | 1 << 10)
        assert cell.receive.isEmergencyStopped()
        assert (cell.receive.getSafetyMode(), cell.receive.getRobotMode()) == (6, 3)
        faults.fault("release_emergency_stop")
        wait_until(lambda: cell.receive.getSafetyStatusBits() == 1)


def test_power_off_in_move_returns_false(cell: Cell) -> None:
    with fault_in_move(cell, "power_off"):
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getRobotMode() == 3)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    assert cell.receive.getSafetyStatusBits() == 1


def test_program_pause_in_move_resumes_on_play(cell: Cell) -> None:
    """A synchronous move says False at once; the arm stands until somebody plays on, then it goes on."""
    with fault_in_move(cell, "program_pause"):
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getRuntimeState() == 4)
    assert not cell.control.isProgramRunning()
    assert cell.receive.getActualQ()[0] < FAR[0] - 0.1
    cell.dashboard.play()
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(FAR, abs=1e-6))


@pytest.mark.parametrize("fraction", [0.1, 0.0])
def test_speed_slider_fault_slows_or_holds_move(cell: Cell, fraction: float) -> None:
    """An asynchronous move crawls or stands, and goes on when the slider is up again."""
    near = [HOME[0] + 0.2, *HOME[1:]]
    with cell.process.control() as faults, PlainClient(cell.address) as every_tick:
        every_tick.outputs("timestamp,actual_q")
        faults.fault("speed_slider", fraction=fraction)
        wait_until(lambda: cell.receive.getTargetSpeedFraction() == fraction)
        every_tick.request("S")
        before = every_tick.sample()[0]
        assert cell.control.moveJ(near, SPEED, ACCELERATION, True)
        after = cell.receive.getTimestamp()
        samples = [every_tick.sample()]
        while samples[-1][0] < after + 0.5:
            samples.append(every_tick.sample())
        assert cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        begun = next((sample[0] for sample in samples if sample[1] > HOME[0] + 1e-9), before)
        turned = [sample[1] - HOME[0] for sample in samples if sample[0] < begun + 0.5]
        assert max(turned) < 0.01
        assert (samples[-1][1] > HOME[0]) == (fraction > 0.0)
        faults.fault("speed_slider", fraction=1.0)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(near, abs=1e-6))


def test_hand_move_causes_protective_stop(cell: Cell) -> None:
    """While a program plays, a push is a protective stop."""
    with cell.process.control() as faults:
        faults.fault("hand_move", joints=[HOME[0] + 0.1, *HOME[1:]], seconds=0.2)
    wait_until(cell.receive.isProtectiveStopped)
    assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getActualQ()[0] == pytest.approx(HOME[0] + 0.1))


def test_time_jump_leaves_move_undisturbed(cell: Cell) -> None:
    before = cell.receive.getTimestamp()
    with cell.process.control() as faults:
        faults.fault("time_jump", seconds=100.0, at_s=0.1)
        assert cell.control.moveJ([q + 0.1 for q in HOME], SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getTimestamp() > before + 100.0)


def test_slow_link_delays_calls(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("delay", port=30004, latency_ms=40, jitter_ms=10, seed=1)
        before = faults.state()["timestamp"]
        assert cell.control.getTCPOffset() == [0.0] * 6
        assert faults.state()["timestamp"] - before > 0.08  # there and back, twice at least
        assert cell.control.moveJ([q + 0.1 for q in HOME], 3.0, 20.0)
        faults.fault("delay", port=30004)
    assert cell.control.getTCPOffset() == [0.0] * 6


def test_dashboard_port_cut_raises(cell: Cell) -> None:
    """Every later call of that client is an error until it connects again."""
    with cell.process.control() as faults:
        faults.fault("cut", port=29999)
    for words in ("End of file", "Broken pipe", "Broken pipe"):
        with pytest.raises(RuntimeError, match=words):
            cell.dashboard.robotmode()
    cell.dashboard.disconnect()
    cell.dashboard.connect()
    assert cell.dashboard.robotmode() == "Robotmode: RUNNING"
