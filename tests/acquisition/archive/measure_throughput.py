"""Sessions solved per second by one worker and by two: `python -m tests.acquisition.archive.measure_throughput`.

Both solve the same sessions of one archive over PostgreSQL, in turns (one, two, one, two …), each call with settings of
its own, so that what else the machine does falls on both. Workers have loaded and compiled the solver before the clock
runs. A ratio of `--turns` pairs, with its standard error.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from distributed import Client

from acquisition.archive import distributed
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity
from acquisition.models.result import SolveSettings
from tests.acquisition.archive import machines, session_copies

READY_WITHIN_S = 120.0


def rate(archive: Archive, keys: Sequence[str], address: str, number: int) -> float:
    """Sessions a second of call `number`, whose settings differ from the others' by as good as nothing."""
    settings = SolveSettings(depth_rounds=1, shadow_threshold=0.08 + 1e-9 * number)
    begun = time.monotonic()
    report = distributed.solve(archive, keys, SolveIdentity(settings=settings), scheduler=address, workers=0)
    if report.solved != len(keys):
        raise SystemExit(f"{report.solved} of {len(keys)} were solved: {report.failures}")
    return len(keys) / (time.monotonic() - begun)


def wait_for_workers(address: str, count: int) -> None:
    """Returns when so many workers have come."""
    with Client(address, timeout=READY_WITHIN_S) as client:
        client.wait_for_workers(count, timeout=READY_WITHIN_S)


def main() -> None:
    """Measures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=24)
    parser.add_argument("--factor", type=int, default=6, help="size of the images, in those of 48 × 48 pixels")
    parser.add_argument("--turns", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, machines.postgres() as database:
        folder = Path(name)
        archive = Archive(str(folder / "archive"), database.address, create=True)
        sessions: list[str] = []
        for seed in range(options.sessions):
            made = session_copies.make(folder / f"20261121-190041-{seed:06x}", seed, results=False)
            sessions.append(archive.push(session_copies.enlarge(made, options.factor, seed)).key)
        ratios: list[float] = []
        clusters = {count: machines.Cluster(folder / f"workers{count}", count) for count in (1, 2)}
        try:
            for count, cluster in clusters.items():
                wait_for_workers(cluster.address, count)
                rate(archive, sessions, cluster.address, count)
            for turn in range(options.turns):
                rates = {
                    count: rate(archive, sessions, cluster.address, 10 * (turn + 1) + count)
                    for count, cluster in clusters.items()
                }
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
