"""The unmodified ur-rtde against the controller: nominal behaviour.

What a controller has to pass, and where; docstrings of tests bear the numbers ("Check 2.").

     1 interfaces construct                    here, links     19 path of three, then a plain move             here
     2 joint move: duration, end                        here   20 asynchronous path tells its progress         here
     3 asynchronous move: id, running bit               here   21 upload, wait until running, move             here
     4 stop in mid-move stands in v/a                   here   22 second clients refused, then served         links
     5 straight move keeps to its line                  here   23 every failure        failures, failing_links, links
     6 forward kinematics is the reported pose          here   24 a secondary program disturbs no move         here
     7 inverse of forward is the identity               here   25 500 packets a second to three clients       links
     8 a pose without solution is reported             here   26 125 and 10 packets a second                 links
     9 inverse kinematics without solution          failures   27 an unknown output is named                  links
    10 the tool's offset moves the pose                 here   28 two cells at once                           links
    11 payload                                          here   29 client killed: inputs are free              links
    12 digital outputs                                    io   30 every method of the dashboard    dashboard_client
    13 analogue outputs                                   io   31 UR's recorder and control loop           examples
    14 speed slider                                     here   32 the library's examples                   examples
    15 limits of joints                                 here   33 bad bytes on each port           robustness, fuzzing
    16 steadiness                                       here   34 200 cycles of connecting               robustness
    17 speed control                                    here   35 upload cut in the middle               robustness
    18 servo control                                    here
"""

import itertools
import math
import re
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.hardware_sim.controller.cells import HOME, Cell, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

SPEED, ACCELERATION = 1.05, 1.4
NEAR = [q + 0.1 for q in HOME]


def duration(length: float, speed: float = SPEED, acceleration: float = ACCELERATION) -> float:
    """Seconds of a trapezoid or triangle from rest to rest."""
    if length < speed**2 / acceleration:
        return 2 * math.sqrt(length / acceleration)
    return length / speed + speed / acceleration


def motion_seconds(cell: Cell, move: Callable[[], bool]) -> float:
    """Controller time that a move takes, tick by tick: the load of the machine does not matter."""
    with PlainClient(cell.address) as every_tick, ThreadPoolExecutor(1) as pool:
        every_tick.outputs("timestamp,actual_qd")
        every_tick.request("S")
        every_tick.sample()
        ended = pool.submit(move)
        samples = [every_tick.sample()]
        while not ended.done() or any(samples[-1][1:]):
            samples.append(every_tick.sample())
        assert ended.result()
    moving = [sample[0] for sample in samples if any(sample[1:])]
    return moving[-1] - moving[0] + 0.004


def test_movej_takes_time_of_trapezoid_and_reaches_target(cell: Cell) -> None:
    """Check 2."""
    target = [q + 0.3 for q in HOME]
    seconds = motion_seconds(cell, lambda: cell.control.moveJ(target, SPEED, ACCELERATION))
    assert seconds == pytest.approx(duration(0.3), abs=0.005)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(target, abs=1e-6))
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)


def test_movej_asynchronous_returns_at_once_and_reports_end(cell: Cell) -> None:
    """Check 3."""
    target = [q + 1.0 for q in HOME]
    before = cell.control.getAsyncOperationProgressEx()
    assert cell.control.moveJ(target, SPEED, ACCELERATION, True)
    wait_until(lambda: cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    running = cell.control.getAsyncOperationProgressEx()
    assert running.operationId() == (before.operationId() + 1) % 128
    assert cell.receive.getActualQ()[0] < target[0]
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(target, abs=1e-6))


def test_stopj_in_move_brakes_at_requested_deceleration(cell: Cell) -> None:
    """Check 4."""
    deceleration = 2.0
    with PlainClient(cell.address) as every_tick, ThreadPoolExecutor(1) as pool:
        every_tick.outputs("timestamp,actual_q,actual_qd")
        every_tick.request("S")
        assert cell.control.moveJ([HOME[0] + 2.5, *HOME[1:]], SPEED, ACCELERATION, True)
        wait_until(lambda: every_tick.sample()[7] > 0.999 * SPEED)
        stop = pool.submit(cell.control.stopJ, deceleration)
        samples = [every_tick.sample()]
        while any(samples[-1][7:]) or not stop.done():
            samples.append(every_tick.sample())
    braking = [sample for sample in samples if 0.0 < sample[7] < 0.999 * SPEED]
    assert braking[-1][0] - braking[0][0] == pytest.approx(SPEED / deceleration, abs=0.006)
    assert braking[-1][1] - braking[0][1] == pytest.approx(SPEED**2 / (2 * deceleration), abs=0.006)
    for earlier, later in itertools.pairwise(braking):  # a reader that is late may miss a tick
        assert (earlier[7] - later[7]) / (later[0] - earlier[0]) == pytest.approx(deceleration, rel=0.01)
    assert not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()


def test_movel_keeps_to_line(cell: Cell) -> None:
    """Check 5."""
    pose = cell.receive.getActualTCPPose()
    target = [*pose[:2], pose[2] + 0.05, *pose[3:]]
    with PlainClient(cell.address) as every_tick:
        every_tick.outputs("actual_TCP_pose")
        every_tick.request("S")
        assert cell.control.moveL(target, 0.25, 1.2, True)
        poses = [every_tick.sample()]
        while poses[-1] != pytest.approx(target, abs=1e-6):
            poses.append(every_tick.sample())
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    for at in poses:
        assert at[:2] == pytest.approx(pose[:2], abs=1e-4)
        assert at[3:] == pytest.approx(pose[3:], abs=1e-4)
    heights = [at[2] for at in poses]
    assert heights == sorted(heights)
    assert len(set(heights)) > 50
    wait_until(lambda: cell.receive.getActualTCPPose() == pytest.approx(target, abs=1e-6))


def test_kinematics_calls_agree(cell: Cell) -> None:
    """Checks 6, 7, 8."""
    pose = cell.control.getForwardKinematics()
    assert pose == pytest.approx(cell.receive.getActualTCPPose(), abs=1e-9)
    joints = cell.receive.getActualQ()
    assert cell.control.getInverseKinematics(pose) == pytest.approx(joints, abs=1e-6)
    assert cell.control.getInverseKinematics(pose, joints) == pytest.approx(joints, abs=1e-6)
    assert cell.control.getInverseKinematicsHasSolution(pose)
    assert not cell.control.getInverseKinematicsHasSolution([5.0, 0.0, 0.5, 0.0, 3.1, 0.0])
    assert cell.control.isProgramRunning()
    other = cell.control.getForwardKinematics(NEAR, [1e-12, 0, 0, 0, 0, 0])
    assert cell.control.getInverseKinematics(other, HOME) == pytest.approx(NEAR, abs=1e-6)


def test_forward_kinematics_of_joints_alone_shows_library_defect(cell: Cell) -> None:
    # ur-rtde 1.6.5 sends no tool offset with it; the script takes what the registers hold from the last move.
    pose = cell.control.getForwardKinematics(HOME)
    assert pose[:3] != pytest.approx(cell.receive.getActualTCPPose()[:3], abs=0.1)
    # With an offset of zeros the packet is longer than its recipe, and the offset lost: its first bytes count.
    assert cell.control.getForwardKinematics(HOME, [0.0] * 6) == pytest.approx(pose, abs=1e-9)
    tiny = cell.control.getForwardKinematics(HOME, [1e-12, 0, 0, 0, 0, 0])
    assert tiny == pytest.approx(cell.receive.getActualTCPPose(), abs=1e-9)


def test_set_tcp_moves_tool_pose(cell: Cell) -> None:
    """Check 10."""
    flange = cell.receive.getActualTCPPose()
    offset = [0.06, 0.0, 0.07, 0.0, math.pi / 2, 0.0]
    assert cell.control.setTcp(offset)
    assert cell.control.getTCPOffset() == pytest.approx(offset, abs=1e-12)
    wait_until(lambda: cell.receive.getActualTCPPose() != flange)
    tool = cell.receive.getActualTCPPose()
    assert math.dist(tool[:3], flange[:3]) == pytest.approx(math.hypot(0.06, 0.07), abs=1e-9)
    assert cell.control.poseTrans(flange, offset) == pytest.approx(tool, abs=1e-6)
    assert cell.control.setTcp([0.0] * 6)


def test_set_payload_is_reported(cell: Cell) -> None:
    """Check 11."""
    assert cell.control.setPayload(0.6, [0.01, 0.0, 0.05])
    wait_until(lambda: cell.receive.getPayload() == 0.6)
    assert cell.receive.getPayloadCog() == [0.01, 0.0, 0.05]
    assert cell.control.setPayload(0.7, [0.0, 0.0, 0.0])  # all zero keeps the centre
    wait_until(lambda: cell.receive.getPayload() == 0.7)
    assert cell.receive.getPayloadCog() == [0.01, 0.0, 0.05]


def test_speed_slider_stretches_move(cell: Cell) -> None:
    """Check 14."""
    assert cell.io.setSpeedSlider(0.5)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == 0.5)
    seconds = motion_seconds(cell, lambda: cell.control.moveJ(NEAR, SPEED, ACCELERATION))
    assert cell.io.setSpeedSlider(1.0)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == 1.0)
    assert seconds == pytest.approx(2 * duration(0.1), abs=0.01)


def test_safety_limits_and_steadiness_are_answered(cell: Cell) -> None:
    """Checks 15, 16."""
    assert not cell.control.isJointsWithinSafetyLimits([7.0] * 6)
    assert cell.control.isJointsWithinSafetyLimits(HOME)
    assert not cell.control.isPoseWithinSafetyLimits([5.0, 0.0, 0.5, 0.0, 3.1, 0.0])
    wait_until(cell.control.isSteady)


def test_speedj_reaches_speed_and_stops(cell: Cell) -> None:
    """Check 17."""
    assert cell.control.speedJ([0.2, 0, 0, 0, 0, 0], 1.0, 0.0)
    wait_until(lambda: cell.receive.getActualQd()[0] == pytest.approx(0.2))
    assert cell.control.speedStop(2.0)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    at = cell.receive.getActualTCPPose()
    assert cell.control.speedL([0.0, 0.0, 0.05, 0, 0, 0], 0.5, 0.0)
    wait_until(lambda: cell.receive.getActualTCPSpeed()[2] == pytest.approx(0.05, abs=1e-6))
    assert cell.control.speedStop(1.0)
    after = cell.receive.getActualTCPPose()
    assert after[:2] == pytest.approx(at[:2], abs=1e-6)
    assert after[2] > at[2] + 0.002


def test_servoj_follows_and_stops(cell: Cell) -> None:
    """Check 18."""
    target = list(HOME)
    for _ in range(100):
        begin = cell.control.initPeriod()
        target[0] += 0.0005
        assert cell.control.servoJ(target, 0.0, 0.0, 0.002, 0.1, 300)
        cell.control.waitPeriod(begin)
    wait_until(lambda: cell.receive.getActualQ()[0] == pytest.approx(target[0], abs=1e-4))
    assert cell.control.servoStop()
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)


def test_movej_path_runs_and_plain_moves_follow(cell: Cell) -> None:
    """Check 19."""
    path = [[*(q + d for q in HOME), 2.0, 5.0, 0.0] for d in (0.05, 0.1, 0.15)]
    assert cell.control.moveJ(path)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx([q + 0.15 for q in HOME], abs=1e-5))
    assert cell.control.moveJ(HOME, 2.0, 5.0)


def test_move_path_asynchronous_reports_progress(cell: Cell) -> None:
    """Check 20."""
    # Over a second for each part: a busy machine sees each number at least once.
    path = [[*(q + d for q in HOME), 0.15, 5.0, 0.0] for d in (0.2, 0.4, 0.2)]
    assert cell.control.moveJ(path, True)
    reported = set()
    wait_until(lambda: cell.control.getAsyncOperationProgress() >= 0)
    while (progress := cell.control.getAsyncOperationProgress()) >= 0:
        reported.add(progress)
    assert reported >= {1, 2}
    # The two interfaces have a connection each: the last packet may still be on its way to the other one.
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx([q + 0.2 for q in HOME], abs=1e-6))


def test_move_path_blended_rounds_corner_without_stopping(cell: Cell) -> None:
    corner, end = list(HOME), list(HOME)
    corner[0] += 0.4
    end[0] += 0.4
    end[1] += 0.4
    with PlainClient(cell.address) as every_tick:
        every_tick.outputs("actual_q,actual_qd")
        every_tick.request("S")
        cell.control.moveJ([[*corner, 1.0, 4.0, 0.05], [*end, 1.0, 4.0, 0.0]], True)
        samples = [every_tick.sample()]
        while samples[-1][1] < HOME[1] + 0.2:
            samples.append(every_tick.sample())
    fast = next(n for n, sample in enumerate(samples) if sample[6] > 0.9)
    slowest = min(math.hypot(*sample[6:]) for sample in samples[fast:])
    nearest = min(max(abs(a - b) for a, b in zip(sample[:6], corner, strict=True)) for sample in samples[fast:])
    wait_until(lambda: cell.control.getAsyncOperationProgress() < 0)
    assert slowest > 0.3
    assert nearest > 0.005
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(end, abs=1e-5))


def test_reupload_replaces_program_and_moves_again(cell: Cell) -> None:
    """Check 21."""
    assert cell.control.reuploadScript()
    wait_until(cell.control.isProgramRunning)
    assert cell.control.moveJ(NEAR, 3.0, 20.0)


def test_custom_script_runs_and_secondary_program_disturbs_nothing(cell: Cell) -> None:
    """Check 24."""
    import socket

    assert cell.control.moveJ(NEAR, 0.2, 1.0, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.1)
    with socket.create_connection((cell.address, 30002)) as script:
        script.sendall(b"sec second():\n  set_digital_out(5, True)\nend\n")
        wait_until(lambda: cell.receive.getActualDigitalOutputBits() == 1 << 5)
        script.sendall(b"sec third():\n  set_digital_out(5, False)\n  movej([0,0,0,0,0,0])\nend\n")
        wait_until(lambda: cell.receive.getActualDigitalOutputBits() == 0)
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(NEAR, abs=1e-6))
    assert cell.control.sendCustomScriptFunction("lines", "movej([0,-1.9,1.9,-1.57,-1.57,0], a=20, v=3)\n")
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(HOME, abs=1e-6))
    assert cell.control.isProgramRunning()


def test_freedrive_and_teach_mode_begin_and_end(cell: Cell) -> None:
    for begin, end in (
        (cell.control.freedriveMode, cell.control.endFreedriveMode),
        (cell.control.teachMode, cell.control.endTeachMode),
    ):
        assert begin()
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
        assert end()
        assert cell.control.moveJ(HOME, 1.0, 1.0)


def test_realtime_getters_return_old_register_values(cell: Cell) -> None:
    """The library reads the answer of the call before; RTDE's own values are to be used instead."""
    pose = cell.control.getForwardKinematics()
    assert cell.control.getActualToolFlangePose() == pose
    assert cell.control.getStepTime() == pose[0]


def test_watchdog_kicked_keeps_move_running(cell: Cell) -> None:
    # A kick every 2 s is due: far longer than a busy machine keeps this process waiting.
    assert cell.control.setWatchdog(0.5)
    assert cell.control.moveJ([HOME[0] + 3.0, *HOME[1:]], 0.3, ACCELERATION, True)
    began = cell.receive.getTimestamp()
    while cell.receive.getTimestamp() < began + 2.5:
        assert cell.control.kickWatchdog()
        time.sleep(0.03)
    assert cell.control.isProgramRunning()
    assert cell.receive.getActualQd()[0] > 0.1
    wait_until(lambda: not cell.control.isProgramRunning())  # the last kick is 2 s ago
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    assert cell.receive.getActualQ()[0] < HOME[0] + 3.0
    assert cell.control.reuploadScript()
    wait_until(cell.control.isProgramRunning)


def test_conformance_checks_each_have_a_test() -> None:
    text = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    named = re.findall(r'\n    """Checks? ([\d, ]+)', text)
    assert {int(number) for result in named for number in re.findall(r"\d+", result)} == set(range(1, 36)) - {23}
    assert text.count('"""Failure:') + text.count(" Failure:") >= 20  # check 23: a test for each


def test_failure_table_names_existing_tests() -> None:
    page = Path(__file__).parents[3] / "docs/reference/ur-rtde-failures.md"
    rows = re.findall(r"  ([a-z_]+(?:, [a-z_]+)*)(?: \(long\))?\n", page.read_text(encoding="utf-8"))
    named = {name for row in rows for name in row.split(", ")}
    assert {"failures", "failing_links", "ordered_faults", "links", "io", "dashboard_client", "conformance"} <= named
    tests = {path.stem.removeprefix("test_") for path in Path(__file__).parent.parent.rglob("test_*.py")}
    assert {name.removeprefix("test_") for name in named} <= tests
