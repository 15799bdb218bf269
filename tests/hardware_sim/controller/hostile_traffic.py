"""Mutated traffic at every port, in shards that can be interrupted and continued; figures of each.

    python -m tests.hardware_sim.controller.hostile_traffic --packets 100000 --record build/hostile.jsonl

Two controllers: one with PolyScope 5, attacked at all its ports, and one with PolyScope X, at its Robot API. A shard is
1,000 packets to each port, its random numbers seeded with the shard's number, and a line in the record; a run that
finds shards of earlier runs in the record goes on behind them, with new controllers.
"""

import argparse
import contextlib
import json
import os
import random
import socket
import struct
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from hardware_sim.controller.process import ControllerProcess
from hardware_sim.controller.robot_api import BASE
from tests.hardware_sim.controller.cells import start, wait_until
from tests.hardware_sim.controller.traffic import PORTS, mutated, piece, recorded

EVERY_PORT = (*PORTS, 30011, 30012, 30013, 30020)
"""Also those at which the library sends nothing: the read-only ones and that of the interpreter mode."""
ROBOT_API = 30080
SHARD = 1000
"""Packets to each port."""
LONGEST_GAP_S = 1.0
"""Between two packets at a bystander: seconds for which the controller's main thread, which makes the ticks, has run.
That leaves out the time for which other work keeps it waiting; in all a gap is at most ten times as long."""
MOST_GROWTH_MB = 60.0

SMALL = {
    29999: [b"running\n", b"load x.urp\n", b"popup hello\n", b"power off\n", b"brake release\n", b"\n", b"x" * 70000],
    30001: [
        b"power off\n",
        b"set robotmode run\n",
        b"stop program\n",
        b"def f():\n  global x = [1, 2]\n  if x[0] > 1:\n    movej(x, a=1)\n  else:\n    sync()\n  end\nend\n",
    ],
    30002: [b"sec s():\n set_digital_out(1, True)\nend\n"],
    30003: [b"x" * 70000, b"movej([0,-1.9,1.9,-1.57,-1.57,0], a=20, v=3)\n"],
    30004: [
        struct.pack(">HBH", 5, ord("V"), 2),
        struct.pack(">HB", 65535, ord("O")) + b"," * 65532,
        struct.pack(">HB", 65535, ord("I")) + b"input_int_register_30," * 2978 + b"," * 16,
        struct.pack(">HBBHB", 7, ord("M"), 255, 3, 1),
    ],
}


def http_requests() -> list[bytes]:
    """What clients of the Robot API send."""
    texts = [
        f"GET {BASE}{path} HTTP/1.1\r\nHost: robot\r\n\r\n"
        for path in ("/robotstate/v1/robotmode", "/system/v1/controlmode", "/versions/v1/", "/program/v1/state", "/?")
    ]
    for path, body in (
        ("/robotstate/v1/state", '{"action": "POWER_OFF"}'),
        ("/robotstate/v1/state", '{"action": "BRAKE_RELEASE"}'),
        ("/program/v1/state", '{"action": "play"}'),
        ("/program/v1/loaded", '{"name": "../x"}'),
        ("/program/v1/loaded", "[" * 5000),
    ):
        texts.append(f"PUT {BASE}{path} HTTP/1.1\r\nContent-Length: {len(body)}\r\n\r\n{body}")
    return [text.encode() for text in texts] + [b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 12_000]


BYSTANDER = """
import json, select, sys, time
from tests.hardware_sim.controller.plain_client import PlainClient
client = PlainClient(sys.argv[1])
running = open(f"/proc/{sys.argv[2]}/schedstat", "rb", buffering=0)

def busy():
    running.seek(0)
    return int(running.read().split()[0]) / 1e9

client.outputs("timestamp")
client.request("S")
client.sample()
print("ready", flush=True)
last, arrived, ran, gap, busiest, missing = client.sample()[0], time.monotonic(), busy(), 0.0, 0.0, 0
while not select.select([sys.stdin], [], [], 0)[0]:
    stamp, now, running_s = client.sample()[0], time.monotonic(), busy()
    missing += round((stamp - last) / 0.002) - 1
    gap, busiest = max(gap, now - arrived), max(busiest, running_s - ran)
    last, arrived, ran = stamp, now, running_s
print(json.dumps({"gap": gap, "busiest": busiest, "missing": missing}), flush=True)
"""


class Bystander:
    """A plain client in a process of its own that notes the packets it misses and how long it waits for one."""

    def __init__(self, process: ControllerProcess) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(BYSTANDER), process.address, str(process.process.pid)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path.cwd(),
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def undisturbed(self) -> float:
        """Ends it; fails where a packet was missing; the longest wait for one in s."""
        output, _ = self._process.communicate("\n", timeout=90)
        reply = json.loads(output)
        assert reply["missing"] == 0
        assert reply["busiest"] < LONGEST_GAP_S
        assert reply["gap"] < 10 * LONGEST_GAP_S
        return float(reply["gap"])


def descriptors(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/fd").iterdir()))


def threads(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/task").iterdir()))


def resident_megabytes(process: ControllerProcess) -> float:
    pages = int(Path(f"/proc/{process.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def attack(address: str, port: int, seeds: Sequence[bytes], packets: int, seed: int) -> None:
    """Sends mutated and random bytes to a port, hanging up now and then; packets that could not be sent do not count.

    Most connections are ended so that the controller reads all of theirs first. Raises OSError where nobody listens any
    more.
    """
    chance = random.Random(seed)  # noqa: S311 - mutations, not secrets
    stream: socket.socket | None = None
    sent = 0
    while sent < packets:
        if stream is None:
            stream = socket.create_connection((address, port), 10.0)
        if chance.random() < 0.2:
            data = chance.randbytes(chance.randrange(1, 200))
        else:
            data = chance.choice(seeds)
            if len(data) > 1000 and sent % 200 and port not in (30004, ROBOT_API):
                data = piece(chance, data)
            data = mutated(chance, data)
        try:
            stream.sendall(data)
            sent += 1
            stream.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while stream.recv(65536):
                    pass
            stream.settimeout(60.0)
            if sent == packets or chance.random() < 0.02:
                if sent == packets or chance.random() < 0.8:
                    stream.shutdown(socket.SHUT_WR)
                    while stream.recv(65536):
                        pass
                raise ConnectionAbortedError  # the end of this connection, from here
        except OSError:
            stream.close()
            stream = None


@dataclass
class Figures:
    """Of one shard at one controller."""

    shard: int
    controller: str
    packets: int  # to each port
    ports: int
    seconds: float
    longest_gap_ms: float
    descriptors_before: int
    descriptors_after: int
    threads: int
    memory_mb: float


class Target:
    """A controller under attack, and what it held before."""

    def __init__(self, name: str, process: ControllerProcess, seeds: dict[int, list[bytes]]) -> None:
        """`seeds`: by port, what is mutated."""
        self.name, self.process, self.seeds = name, process, seeds
        self.before = descriptors(process), threads(process), resident_megabytes(process)

    def survives(self, shard: int, packets: int = SHARD) -> Figures:
        """Attacks each port with so many packets. Fails where the controller ends, is late, or keeps anything."""
        began = time.monotonic()
        bystander = Bystander(self.process)
        for port, seeds in self.seeds.items():
            attack(self.process.address, port, seeds, packets, shard)
        gap = bystander.undisturbed()
        held, running, memory = self.before
        wait_until(lambda: descriptors(self.process) == held)
        assert self.process.process.poll() is None
        assert threads(self.process) == running
        assert resident_megabytes(self.process) < memory + MOST_GROWTH_MB
        with self.process.control() as control:
            control.fault("clear")
            control.fault("program_stop")
            assert control.state()["ok"]
        return Figures(
            shard, self.name, packets, len(self.seeds), round(time.monotonic() - began, 1), round(1e3 * gap, 1), held,
            descriptors(self.process), running, round(resident_megabytes(self.process), 1),
        )  # fmt: skip


def library_traffic(process: ControllerProcess) -> dict[int, list[bytes]]:
    """What the library sends to a controller in a session, by port."""
    with start() as free:
        address = free.address
    return recorded(process, address)


def polyscope_5(process: ControllerProcess, traffic: dict[int, list[bytes]]) -> Target:
    """All ports of a controller; what is sent to them derives from the library's traffic."""
    like = {port: port if port in PORTS else 30001 for port in EVERY_PORT}
    return Target("5", process, {port: traffic[of] + SMALL[of] * 2 for port, of in like.items()})


def polyscope_x(process: ControllerProcess) -> Target:
    """The Robot API of a controller that has one, at `ROBOT_API`."""
    return Target("x", process, {ROBOT_API: http_requests()})


def main() -> None:
    """Reads the command line, runs the shards that the record lacks and prints the figures of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packets", type=int, default=100_000, help="to each port")
    parser.add_argument("--record", type=Path, required=True, help="a line of JSON for each shard")
    arguments = parser.parse_args()
    text = arguments.record.read_text(encoding="utf-8") if arguments.record.exists() else ""
    rows = [json.loads(line) for line in text.splitlines()]
    first = max((row["shard"] + 1 for row in rows if row["controller"] == "x"), default=0)
    with ExitStack() as stack, arguments.record.open("a", encoding="utf-8") as record:
        five = stack.enter_context(start(speed=20.0, log_level="ERROR"))
        x = stack.enter_context(start(speed=20.0, polyscope="x", robot_api_port=ROBOT_API, log_level="ERROR"))
        targets = [polyscope_5(five, library_traffic(five)), polyscope_x(x)]
        for shard in range(first, -(-arguments.packets // SHARD)):
            for target in targets:
                rows.append(asdict(target.survives(shard)))
                record.write(json.dumps(rows[-1]) + "\n")
            record.flush()
    for name in ("5", "x"):
        of = {row["shard"]: row for row in rows if row["controller"] == name}
        memory = [row["memory_mb"] for row in of.values()]
        sys.stdout.write(
            f"PolyScope {name}: {SHARD * len(of)} packets to each of {of[0]['ports']} ports"
            f" in {sum(row['seconds'] for row in of.values()):.0f} s, no crash, no missing packet;"
            f" longest gap {max(row['longest_gap_ms'] for row in of.values()):.0f} ms;"
            f" descriptors {of[0]['descriptors_before']} → {of[max(of)]['descriptors_after']};"
            f" memory {memory[0]:.1f} → {memory[-1]:.1f} MB, at most {max(memory):.1f}\n"
        )


if __name__ == "__main__":
    main()
