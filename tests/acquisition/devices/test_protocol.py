"""The shared memory of service and driver: fields, samples, and a torn sample, which its checksum rejects."""

import dataclasses
import os
import subprocess
import sys
import time

import pytest

from acquisition.devices.ur.protocol import TRACK_LENGTH, Field, Link, Sample, SharedMemory

SAMPLE = Sample(
    joints=(0.1, -0.2, 0.3, -0.4, 0.5, -0.6),
    joint_speeds=(0.0,) * 6,
    base_from_tool=(0.4, 0.1, 0.3, 0.0, 3.1, 0.0),
    timestamp=12.5,
    speed_fraction=0.75,
    received_at=99.25,
    robot_mode=7,
    safety_bits=1,
    runtime_state=2,
    digital_outputs=1 << 17,
    program_running=True,
    link=Link.OK,
)


def test_shared_memory_without_sample_returns_none() -> None:
    assert SharedMemory.create().sample() is None


def test_shared_memory_sample_round_trip_is_exact() -> None:
    memory = SharedMemory.create()
    memory.publish(SAMPLE)
    assert memory.sample() == SAMPLE


def test_shared_memory_torn_sample_returns_none() -> None:
    memory = SharedMemory.create()
    memory.publish(SAMPLE)
    position = 64 + 8 * 3
    os.pwrite(memory.descriptor, b"\x55\x55", position)
    assert memory.sample() is None
    memory.publish(SAMPLE)
    assert memory.sample() == SAMPLE


def test_shared_memory_fields_are_seen_by_another_process() -> None:
    memory = SharedMemory.create()
    memory.write(Field.HALT_REQUESTED, 123456789012345)
    code = (
        "import sys; from acquisition.devices.ur.protocol import SharedMemory, Field;"
        "b = SharedMemory(int(sys.argv[1]));"
        "b.write(Field.HALT_ACCEPTED, b.read(Field.HALT_REQUESTED))"
    )
    command = [sys.executable, "-c", code, str(memory.descriptor)]
    subprocess.run(command, check=True, pass_fds=(memory.descriptor,))
    assert memory.read(Field.HALT_ACCEPTED) == 123456789012345
    assert memory.read(Field.LEASE) == 0


@pytest.mark.parametrize(
    ("accepted", "done", "state"),
    [(5, 5, (False, False)), (5, 3, (True, False)), (7, 5, (True, False)), (7, 7, (True, True))],
)
def test_halt_state_halt_in_progress_serves_later_requests(accepted: int, done: int, state: tuple[bool, bool]) -> None:
    memory = SharedMemory.create()
    memory.write(Field.HALT_ACCEPTED, accepted)
    memory.write(Field.HALT_DONE, done)
    assert memory.halt_state(7) == state


def test_shared_memory_concurrent_reader_sees_no_mixed_sample() -> None:
    """Of two samples that another process, which may run at the same instant, publishes in turn."""
    memory = SharedMemory.create()
    memory.publish(SAMPLE)
    other = dataclasses.replace(SAMPLE, joints=(9.0,) * 6, timestamp=77.0, link=Link.SILENT)
    code = (
        "import dataclasses, sys; from acquisition.devices.ur.protocol import SharedMemory;"
        "b = SharedMemory(int(sys.argv[1]));"
        "one = b.sample(); silent = type(one.link).SILENT\n"
        "other = dataclasses.replace(one, joints=(9.0,) * 6, timestamp=77.0, link=silent)\n"
        "while True: b.publish(other); b.publish(one)"
    )
    command = [sys.executable, "-c", code, str(memory.descriptor)]
    samples: set[Sample | None] = set()
    reads, until = 0, time.monotonic() + 30
    with subprocess.Popen(command, pass_fds=(memory.descriptor,)) as writer:
        try:
            while (reads < 3000 or other not in samples) and time.monotonic() < until:
                reads += 1
                samples.add(memory.sample())
        finally:
            writer.kill()
    assert samples - {None} == {SAMPLE, other}


def test_shared_memory_track_keeps_the_newest_points_in_order() -> None:
    memory = SharedMemory.create()
    assert memory.track(1.0) == []
    for number in range(TRACK_LENGTH + 40):
        memory.publish(dataclasses.replace(SAMPLE, timestamp=0.008 * number, received_at=0.008 * number + 0.003))
        memory.publish(dataclasses.replace(SAMPLE, timestamp=0.008 * number, robot_mode=3))  # no new data
    points = memory.track(100.0)
    assert [round(point[0] / 0.008) for point in points] == list(
        range(41, TRACK_LENGTH + 40)
    )  # the oldest may be overwritten
    assert points[-1][2:8] == SAMPLE.joints
    assert points[-1][8:] == SAMPLE.base_from_tool
    assert len(memory.track(0.1)) == 13
    other = SharedMemory(memory.descriptor)  # the next driver's: its points follow
    other.publish(dataclasses.replace(SAMPLE, timestamp=99.0))
    assert memory.track(0.0)[-1][0] == 99.0
