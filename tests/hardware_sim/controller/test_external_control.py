"""External control: a program that takes joint targets from a client over a socket of its own, as drivers do.

The program has two threads that share the target in critical sections: one reads a target for each cycle, the other
servos to it. The client keeps some targets ahead, so that its own scheduling on a busy machine is no missed cycle.
"""

import math
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.steering import JointServo
from hardware_sim.controller.trace import read_trace
from tests.hardware_sim.controller.cells import send_script, start, wait_until
from tests.hardware_sim.controller.programs import HOME, TICK

SCALE = 1_000_000_000 / 4  # per rad: 8 rad fit an integer
AHEAD = 500  # targets, a second of them, sent before the arm asks for them

PROGRAM = """def external_control():
  global target = get_joint_positions()
  global active = True
  global servo_cycles = 0
  global missed = 0
  global lost = 0
  global fresh = 0
  thread servo():
    while active:
      enter_critical
      q = target
      if fresh == 0:
        missed = missed + 1
      end
      fresh = 0
      servo_cycles = servo_cycles + 1
      exit_critical
      servoj(q, t=get_steptime(), lookahead_time=0.03, gain=300)
    end
    stopj(4.0)
  end
  def take(values):
    local scaled = [0, 0, 0, 0, 0, 0]
    i = 0
    while i < 6:
      scaled[i] = values[i + 1] / SCALE
      i = i + 1
    end
    enter_critical
    target = scaled
    fresh = fresh + 1
    lost = missed  # until this target: after the last one the servo has none to go to
    exit_critical
  end
  socket_open("127.0.0.1", PORT, "reverse")
  values = socket_read_binary_integer(6, "reverse", 0)
  take(values)
  handle = run servo()
  while values[0] == 6:
    socket_send_int(servo_cycles, "reverse")
    sync()
    values = socket_read_binary_integer(6, "reverse", 10)
    if values[0] == 6:
      take(values)
    end
  end
  enter_critical
  active = False
  join handle
  exit_critical
  textmsg(str_cat("external control ended: ", servo_cycles), str_cat(" of which missed ", lost))
end
"""


def targets(count: int) -> Iterator[list[int]]:
    """Targets of all joints, as they are sent: slow sines that begin at rest at home."""
    for n in range(count):
        swing = 1.0 - math.cos(2.0 * math.pi * n * TICK / 3.0)
        yield [round((q + 0.1 * swing / (joint + 1)) * SCALE) for joint, q in enumerate(HOME)]


def serve(listener: socket.socket, count: int) -> None:
    """Sends so many targets, `AHEAD` before they are asked for, and hangs up."""
    stream, _ = listener.accept()
    with stream:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        asked = 0
        for number, target in enumerate(targets(count)):
            while number - asked >= AHEAD:
                data = stream.recv(4096)
                assert data, "the program has hung up"
                asked += len(data) // 4
            stream.sendall(struct.pack(">6i", *target))
        stream.shutdown(socket.SHUT_WR)
        while stream.recv(4096):
            pass


def followed_path(count: int) -> list[list[float]]:
    """The joints after each cycle where the targets reach the servo one in each, without program or socket."""
    servo = JointServo(MODELS["ur5e"], HOME, [0.0] * 6)
    servo.lookahead = 0.03
    path: list[list[float]] = []
    for target in targets(count):
        servo.target = [q / SCALE for q in target]
        path.append(servo.step(TICK, 1.0)[0])
    return path


def check(count: int, folder: Path) -> None:
    """Runs so many cycles: none is missed, the arm's path is that of the targets, the hung-up socket stops it."""
    record = folder / "ticks.bin"
    with start(record=record) as controller, socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(60.0)
        port = listener.getsockname()[1]
        send_script(controller.address, PROGRAM.replace("PORT", str(port)).replace("SCALE", repr(SCALE)))
        serve(listener, count)
        with controller.control() as truth:
            wait_until(lambda: not truth.state()["program_running"] and not any(truth.state()["joint_speeds"]))
            said = next(line for line in truth.log() if "external control ended" in line)
    cycles, missed = (int(word) for word in said.rpartition("ended: ")[2].split(" of which missed "))
    assert missed == 0
    assert count - 1 <= cycles <= count + 2  # the first target is where it stands; the end takes a tick to be seen
    ran = read_trace(record).joints
    path = np.array(followed_path(count))
    moved, led = (int(np.flatnonzero(np.any(joints != joints[0], axis=1))[0]) for joints in (ran, path))
    length = count - led - 1
    assert length > 0.9 * count
    assert np.abs(ran[moved : moved + length] - path[led : led + length]).max() < 1e-6


def test_external_control_misses_no_cycle(tmp_path: Path) -> None:
    check(200, tmp_path)


@pytest.mark.long
def test_external_control_for_a_minute_misses_no_cycle(tmp_path: Path) -> None:
    check(30_000, tmp_path)
