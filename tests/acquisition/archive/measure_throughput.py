"""Sessions solved per second by one worker and by two: `python -m tests.acquisition.archive.measure_throughput`.

Both solve the same sessions of one archive over PostgreSQL, in turns (one, two, one, two …), each call with settings of
its own, so that what else the machine does falls on both. Workers have loaded and compiled the solver before the clock
runs. A ratio of `--turns` pairs, with its standard error.

Of each call it is said where the time went. The workers' solving threads were running, ready to run while other
processes had the cores, or idle (waiting for work, files or the catalogue); `/proc` tells them apart, whatever else the
machine does. And the time of a core that each part took for a session: with one worker the rest has the other core for
itself, with two it takes from them.
"""

import argparse
import statistics
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from distributed import Client

from acquisition.archive import distributed
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity
from acquisition.models.result import SolveSettings
from tests.acquisition.archive import machines, session_copies

READY_WITHIN_S = 120.0


def processor_s(pid: int) -> float:
    """Time of a core, s, that a process and its descendants have taken."""
    process = psutil.Process(pid)
    own = process.cpu_times()
    total = own.user + own.system + own.children_user + own.children_system
    for child in process.children(recursive=True):
        times = child.cpu_times()
        total += times.user + times.system
    return total


def solving_threads(dask_worker: Any) -> tuple[float, float]:
    """Times, s, that a worker's solving threads have run, and have been ready to run (proc(5), schedstat)."""
    running = ready = 0
    for thread in threading.enumerate():
        if thread in dask_worker.executors["default"]._threads:
            times = Path(f"/proc/self/task/{thread.native_id}/schedstat").read_text().split()
            running, ready = running + int(times[0]), ready + int(times[1])
    return running / 1e9, ready / 1e9


@dataclass(frozen=True)
class Clocks:
    """Clocks of one moment: the wall's, the solving threads', and of a core by the part that takes it."""

    wall_s: float
    threads_s: tuple[float, float]
    parts_s: dict[str, float]


class Bench:
    """An archive over PostgreSQL, and clusters of workers that solve it."""

    def __init__(self, archive: Archive, sessions: Sequence[str], database: machines.Postgres) -> None:
        self._archive, self._sessions, self._database = archive, sessions, database
        self._number = 0

    def rate(self, cluster: machines.Cluster, count: int) -> float:
        """Sessions a second of one call, whose settings differ from the others' by as good as nothing."""
        self._number += 1
        settings = SolveSettings(depth_rounds=1, shadow_threshold=0.08 + 1e-9 * self._number)
        with Client(cluster.address, timeout=READY_WITHIN_S) as client:
            client.wait_for_workers(count, timeout=READY_WITHIN_S)
            before = self._clocks(client, cluster)
            report = distributed.solve(
                self._archive, self._sessions, SolveIdentity(settings=settings), scheduler=cluster.address, workers=0
            )
            after = self._clocks(client, cluster)
        if report.solved != len(self._sessions):
            raise SystemExit(f"{report.solved} of {len(self._sessions)} were solved: {report.failures}")
        self._print(before, after, count)
        return len(self._sessions) / (after.wall_s - before.wall_s)

    def _clocks(self, client: Client, cluster: machines.Cluster) -> Clocks:
        threads = client.run(solving_threads).values()
        own = psutil.Process().cpu_times()
        return Clocks(
            time.monotonic(),
            (sum(running for running, _ in threads), sum(ready for _, ready in threads)),
            {
                "workers": sum(processor_s(worker.pid) for worker in cluster.workers),
                "scheduler": processor_s(cluster.scheduler.pid),
                "database": processor_s(self._database.pid),
                "caller": own.user + own.system,
            },
        )

    def _print(self, before: Clocks, after: Clocks, count: int) -> None:
        seconds = after.wall_s - before.wall_s
        running, ready = (last - first for first, last in zip(before.threads_s, after.threads_s, strict=True))
        idle = count * seconds - running - ready
        parts = {name: (after.parts_s[name] - before.parts_s[name]) / len(self._sessions) for name in after.parts_s}
        taken = ", ".join(f"{name} {value:.3f}" for name, value in parts.items())
        print(f"{count} at work for {seconds:.1f} s: {running / count / seconds:.0%} running, "
              f"{ready / count / seconds:.0%} ready, {idle / count / seconds:.0%} idle; "
              f"running {running / len(self._sessions):.3f} s a session; of a core: {taken}", flush=True)  # fmt: skip


def main() -> None:
    """Measures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=24)
    parser.add_argument("--factor", type=int, default=6, help="size of the images, in those of 48 × 48 pixels")
    parser.add_argument("--turns", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, machines.postgres() as database:
        folder = Path(name)
        archive = Archive.create(str(folder / "archive"), database.address)
        sessions: list[str] = []
        for seed in range(options.sessions):
            made = session_copies.make(folder / f"20261121-190041-{seed:06x}", seed, results=False)
            sessions.append(archive.push(session_copies.enlarge(made, options.factor, seed)).key)
        bench = Bench(archive, sessions, database)
        ratios: list[float] = []
        clusters = {count: machines.Cluster(folder / f"workers{count}", count) for count in (1, 2)}
        try:
            for count, cluster in clusters.items():
                bench.rate(cluster, count)
            print("loaded and compiled", flush=True)
            for _ in range(options.turns):
                rates = {count: bench.rate(cluster, count) for count, cluster in clusters.items()}
                ratios.append(rates[2] / rates[1])
                print(f"{rates[1]:.3f} and {rates[2]:.3f} sessions a second: {ratios[-1]:.2f}", flush=True)
        finally:
            for cluster in clusters.values():
                cluster.close()
            archive.close()
        error = statistics.stdev(ratios) / len(ratios) ** 0.5 if len(ratios) > 1 else float("nan")
        print(f"two workers / one: {statistics.mean(ratios):.2f} ± {error:.2f}")


if __name__ == "__main__":
    main()
