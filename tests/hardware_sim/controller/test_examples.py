"""Example programs: the library's documented ones, and UR's own two by a plain RTDE client."""

import csv
import itertools
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, send_script, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient


@pytest.fixture(scope="module")
def controller() -> Iterator[ControllerProcess]:
    """One controller for all examples: each brings its clients."""
    with start() as process:
        yield process


@pytest.fixture(scope="module")
def connected(controller: ControllerProcess) -> Iterator[Any]:
    """The library's control client."""
    import rtde_control

    control = rtde_control.RTDEControlInterface(controller.address)
    yield control
    control.disconnect()


@pytest.fixture
def control(connected: Any) -> Any:
    """The library's control client, its program running, the arm at home."""
    if not connected.isProgramRunning():
        connected.reuploadScript()
        wait_until(connected.isProgramRunning)
    assert connected.moveJ(HOME, 3.0, 20.0)
    return connected


@pytest.fixture(scope="module")
def receive(controller: ControllerProcess) -> Iterator[Any]:
    """The library's receive client."""
    import rtde_receive

    receive = rtde_receive.RTDEReceiveInterface(controller.address)
    yield receive
    receive.disconnect()


def test_example_io_switches_outputs(controller: ControllerProcess, receive: Any) -> None:
    """Check 32: io_example, with its fixed pauses of 10 ms turned into waiting for the read-back."""
    import rtde_io

    io = rtde_io.RTDEIOInterface(controller.address)
    for level in (True, False):
        io.setStandardDigitalOut(7, level)
        io.setToolDigitalOut(0, level)
        wait_until(lambda level=level: receive.getDigitalOutState(7) == receive.getDigitalOutState(16) == level)
    io.setAnalogOutputCurrent(1, 0.25)
    wait_until(lambda: receive.getStandardAnalogOutput1() == pytest.approx(0.008))
    io.disconnect()


def test_example_move_async_stops_and_reverses(control: Any, receive: Any) -> None:
    """Check 32: move_async_example."""
    target = receive.getActualTCPPose()
    start_height = target[2]
    target[2] += 0.10
    assert control.moveL(target, 0.05, 0.5, True)
    wait_until(lambda: receive.getActualTCPPose()[2] > start_height + 0.005)
    control.stopL(0.5)
    assert start_height < receive.getActualTCPPose()[2] < target[2]
    joints = receive.getActualQ()
    joints[0] += 1.0
    assert control.moveJ(joints, 0.5, 1.4, True)
    wait_until(lambda: receive.getActualQd()[0] > 0.1)
    control.stopJ(0.5)
    wait_until(lambda: receive.getActualQd() == [0.0] * 6)
    assert HOME[0] < receive.getActualQ()[0] < joints[0]


def test_example_servoj_runs(control: Any, receive: Any) -> None:
    """Check 32: servoj_example."""
    joints = list(HOME)
    for _ in range(250):
        began = control.initPeriod()
        assert control.servoJ(joints, 0.5, 0.5, 0.002, 0.1, 300)
        joints[0] += 0.001
        joints[1] += 0.001
        control.waitPeriod(began)
    assert control.servoStop()
    control.stopScript()
    wait_until(lambda: not control.isProgramRunning())
    assert receive.getActualQ()[0] > HOME[0] + 0.1


def test_example_speedj_runs(control: Any, receive: Any) -> None:
    """Check 32: speedj_example."""
    speeds = [0.0] * 6
    for _ in range(250):
        began = control.initPeriod()
        assert control.speedJ(speeds, 0.5, 0.002)
        speeds[0] += 0.001
        speeds[1] += 0.001
        control.waitPeriod(began)
    assert receive.getActualQd()[0] > 0.1
    assert control.speedStop()
    control.stopScript()
    wait_until(lambda: not control.isProgramRunning())
    wait_until(lambda: receive.getActualQd() == [0.0] * 6)


def test_example_movel_path_blends(controller: ControllerProcess, control: Any, receive: Any) -> None:
    """Check 32: movel_path_with_blend_example."""
    corner = receive.getActualTCPPose()
    corner[2] += 0.10
    end = [corner[0], corner[1] + 0.10, *corner[2:]]
    begin = receive.getActualTCPPose()
    path = [[*pose, 0.5, 1.5, blend] for pose, blend in ((begin, 0.0), (corner, 0.02), (end, 0.0))]
    speeds, nearest = [], 1.0
    with PlainClient(controller.address) as every_tick:
        every_tick.outputs("actual_TCP_pose,actual_TCP_speed")
        every_tick.request("S")
        assert control.moveL(path, True)
        sample = every_tick.sample()
        while sample[:6] != pytest.approx(end, abs=1e-5):
            distance = math.dist(sample[:3], corner[:3])
            nearest = min(nearest, distance)
            if distance < 0.018:
                speeds.append(math.hypot(*sample[6:9]))
            sample = every_tick.sample()
    assert nearest > 0.002  # it cuts the corner …
    assert min(speeds) > 0.1  # … without standing
    wait_until(lambda: receive.getActualTCPPose() == pytest.approx(end, abs=1e-5))


def test_example_move_path_async_runs(control: Any, receive: Any) -> None:
    """Check 32: move_path_async_example."""
    import rtde_control

    entry, path = rtde_control.PathEntry, rtde_control.Path()
    pose = receive.getActualTCPPose()
    pose[2] += 0.05
    joints = [q + 0.1 for q in HOME]
    for kind, positions, values in (
        (entry.MoveJ, entry.PositionTcpPose, [*pose, 0.1, 4.0, 0.0]),
        (entry.MoveL, entry.PositionTcpPose, [*pose[:2], pose[2] - 0.05, *pose[3:], 0.03, 2.0, 0.0]),
        (entry.MoveJ, entry.PositionJoints, [*joints, 0.07, 4.0, 0.0]),
    ):
        path.addEntry(entry(kind, positions, values))
    assert path.size() == 3
    assert control.movePath(path, True)
    progress = []
    wait_until(lambda: control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    while (status := control.getAsyncOperationProgressEx()).isAsyncOperationRunning():
        progress.append(status.progress())
    assert progress == sorted(progress)
    assert set(progress) >= {1, 2}
    wait_until(lambda: receive.getActualQ() == pytest.approx(joints, abs=1e-5))
    # Another one is stopped on its way.
    assert control.movePath(path, True)
    wait_until(lambda: any(receive.getActualQd()))
    control.stopJ(2.0)
    wait_until(lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    wait_until(lambda: receive.getActualQd() == [0.0] * 6)  # the other connection hears of it later


def test_example_record_data_writes_file(receive: Any, tmp_path: Path) -> None:
    """Check 32: record_data_example."""
    path = tmp_path / "robot_data.csv"
    assert receive.startFileRecording(str(path), ["timestamp", "actual_q", "actual_TCP_pose"])
    for _ in range(100):
        began = receive.initPeriod()
        receive.waitPeriod(began)
    receive.stopFileRecording()
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 20
    assert {f"actual_q_{n}" for n in range(6)} < set(rows[0])
    stamps = [float(row["timestamp"]) for row in rows]
    assert stamps == sorted(stamps)


def test_example_forcemode_goes_down_and_up(control: Any, receive: Any) -> None:
    """Check 32: forcemode_example, 0.4 s each way instead of 2 s."""
    frame, along_z = [0.0] * 6, [0, 0, 1, 0, 0, 0]
    assert control.moveJ([-1.54, -1.83, -2.28, -0.59, 1.60, 0.023], 3.0, 20.0)
    start = receive.getActualTCPPose()
    lowest = start[2]
    for force, cycles in ((-10.0, 200), (10.0, 200)):
        for _ in range(cycles):
            begin = control.initPeriod()
            assert control.forceMode(
                frame, along_z, [0.0, 0.0, force, 0.0, 0.0, 0.0], 2, [2.0, 2.0, 1.5, 1.0, 1.0, 1.0]
            )
            control.waitPeriod(begin)
            lowest = min(lowest, receive.getActualTCPPose()[2])
    assert control.forceModeStop()
    end = receive.getActualTCPPose()
    # 10 N move the free tool at 50 mm/s: 20 mm down, and up again.
    assert lowest == pytest.approx(start[2] - 0.02, abs=0.015)
    assert end[2] - lowest == pytest.approx(start[2] - lowest, abs=0.015)
    assert end[:2] == pytest.approx(start[:2], abs=1e-4)


def test_example_contact_stops_where_tool_touches(controller: ControllerProcess, control: Any, receive: Any) -> None:
    """Check 32: move_until_contact_example; the controller has a surface to touch."""
    assert control.moveJ(HOME, 3.0, 20.0)
    x, y, z = receive.getActualTCPPose()[:3]
    with controller.control() as world:
        world.surface([x, y, z - 0.03], [0.0, 0.0, 1.0], 5000.0)
        assert control.moveUntilContact([0.0, 0.0, -0.1, 0.0, 0.0, 0.0])
        world.surface([0.0] * 3, [0.0, 0.0, 1.0], 0.0)
    wait_until(lambda: receive.getActualTCPPose()[:3] == pytest.approx([x, y, z - 0.03], abs=5e-4))


RECORDED = [
    "timestamp",
    "target_q",
    "actual_q",
    "actual_qd",
    "actual_TCP_pose",
    "runtime_state",
    "actual_digital_output_bits",
]


def test_example_ur_recorder_runs(controller: ControllerProcess, tmp_path: Path) -> None:
    """Check 31: what UR's record.py does: a row per packet, none missing."""
    path = tmp_path / "robot_data.csv"
    with PlainClient(controller.address) as client, path.open("w", newline="") as file:
        assert struct.unpack(">4I", client.request("v"))[:2] == (5, 11)
        recipe, types = client.outputs(",".join(RECORDED), 125.0)
        assert recipe == 1
        counts = [6 if kind.startswith("VECTOR6") else 1 for kind in types]
        names = [[n] if c == 1 else [f"{n}_{i}" for i in range(c)] for n, c in zip(RECORDED, counts, strict=True)]
        table = csv.writer(file, delimiter=" ")
        table.writerow(itertools.chain(*names))
        assert client.request("S") == b"\x01"
        for _ in range(100):
            table.writerow(client.sample())
        assert client.request_between_packets("P") == b"\x01"
    rows = list(csv.DictReader(path.read_text().splitlines(), delimiter=" "))
    assert len(rows) == 100
    steps = [float(b["timestamp"]) - float(a["timestamp"]) for a, b in itertools.pairwise(rows)]
    assert steps == pytest.approx([0.008] * 99)


def test_example_ur_control_loop_runs(controller: ControllerProcess) -> None:
    """Check 31: what UR's example_control_loop.py does: set points by registers, hand-shake by two integers.

    In the upper range, beside a client of the library that owns the lower one.
    """
    program = """
    def follow():
      write_output_integer_register(24, 0)
      while True:
        write_output_integer_register(24, 1)
        while read_input_integer_register(24) != 1:
          sync()
        end
        write_output_integer_register(24, 2)
        target = p[0, 0, 0, 0, 0, 0]
        i = 0
        while i < 6:
          target[i] = read_input_float_register(24 + i)
          i = i + 1
        end
        movej(target, a=20, v=3)
        write_output_integer_register(24, 0)
        while read_input_integer_register(24) != 0:
          sync()
        end
      end
    end
    """
    with PlainClient(controller.address) as client:
        client.outputs("actual_TCP_pose,output_int_register_24")
        points, _ = client.inputs(",".join(f"input_double_register_{n}" for n in range(24, 30)))
        watchdog, _ = client.inputs("input_int_register_24")
        client.write(watchdog, 0)
        client.request("S")
        send_script(controller.address, program)
        begin = client.sample()[:6]
        raised = (*begin[:2], begin[2] + 0.05, *begin[3:])
        for target in (raised, begin, raised):
            wait_until(lambda: client.sample()[-1] == 1)
            client.write(points, *target)
            client.write(watchdog, 1)
            wait_until(lambda: client.sample()[-1] == 2)
            wait_until(lambda target=target: client.sample()[:6] == pytest.approx(target, abs=1e-6))
            client.write(watchdog, 0)
