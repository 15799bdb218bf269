"""The board: words, samples, and a torn sample that is never believed."""

import dataclasses
import os
import subprocess
import sys
import time

import pytest

from acquisition.devices.ur.protocol import Board, Link, Sample, Word

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
    link=Link.WELL,
)


def test_empty_board_has_no_sample() -> None:
    assert Board.create().sample() is None


def test_sample_survives_the_board() -> None:
    board = Board.create()
    board.publish(SAMPLE)
    assert board.sample() == SAMPLE


def test_torn_sample_is_not_believed() -> None:
    board = Board.create()
    board.publish(SAMPLE)
    position = 64 + 8 * 3
    os.pwrite(board.descriptor, b"\x55\x55", position)
    assert board.sample() is None
    board.publish(SAMPLE)
    assert board.sample() == SAMPLE


def test_words_are_shared_with_another_process() -> None:
    board = Board.create()
    board.write(Word.HALT_REQUESTED, 123456789012345)
    code = (
        "import sys; from acquisition.devices.ur.protocol import Board, Word; b = Board(int(sys.argv[1]));"
        "b.write(Word.HALT_TAKEN, b.read(Word.HALT_REQUESTED))"
    )
    command = [sys.executable, "-c", code, str(board.descriptor)]
    subprocess.run(command, check=True, pass_fds=(board.descriptor,))
    assert board.read(Word.HALT_TAKEN) == 123456789012345
    assert board.read(Word.LEASE) == 0


@pytest.mark.parametrize(
    ("taken", "done", "state"),
    [(5, 5, (False, False)), (5, 3, (True, False)), (7, 5, (True, False)), (7, 7, (True, True))],
)
def test_a_halt_that_is_carried_out_serves_those_after_it(taken: int, done: int, state: tuple[bool, bool]) -> None:
    board = Board.create()
    board.write(Word.HALT_TAKEN, taken)
    board.write(Word.HALT_DONE, done)
    assert board.halt_state(7) == state


def test_reader_never_sees_a_mixture() -> None:
    """Of two samples that another process, which may run at the same instant, publishes in turn."""
    board = Board.create()
    board.publish(SAMPLE)
    other = dataclasses.replace(SAMPLE, joints=(9.0,) * 6, timestamp=77.0, link=Link.SILENT)
    code = (
        "import dataclasses, sys; from acquisition.devices.ur.protocol import Board; b = Board(int(sys.argv[1]));"
        "one = b.sample(); silent = type(one.link).SILENT\n"
        "other = dataclasses.replace(one, joints=(9.0,) * 6, timestamp=77.0, link=silent)\n"
        "while True: b.publish(other); b.publish(one)"
    )
    command = [sys.executable, "-c", code, str(board.descriptor)]
    seen: set[Sample | None] = set()
    reads, until = 0, time.monotonic() + 30
    with subprocess.Popen(command, pass_fds=(board.descriptor,)) as writer:
        try:
            while (reads < 3000 or other not in seen) and time.monotonic() < until:
                reads += 1
                seen.add(board.sample())
        finally:
            writer.kill()
    assert seen - {None} == {SAMPLE, other}
