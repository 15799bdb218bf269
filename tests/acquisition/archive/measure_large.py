"""One large capture, by one process and in tiles by two workers: `python -m tests.acquisition.archive.measure_large`.

The capture of release 0.1 enlarged `--factor` times (72: 12 megapixels) goes into an archive; a process of its own with
all cores solves it, then two worker processes with one core each. Prints times (of the clock and of a core), bytes in
the archive, the peak of each process's resident memory and what it was before (the program alone), and the largest
difference of the maps.
"""

import argparse
import multiprocessing
import os
import resource
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster

from acquisition.archive import distributed, solving
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity, result_name
from acquisition.archive.solving import SolveJob, Tiling
from acquisition.formats import export
from acquisition.models.result import SolveSettings
from tests.acquisition.archive import session_copies

ONE_PIECE = Tiling(from_values=1 << 62)
IN_TILES = Tiling(from_values=1)
SETTINGS = {name: SolveSettings(depth_rounds=1, shadow_threshold=0.08 + step) for name, step in
            (("one process", 0.0), ("two workers", 1e-12))}  # fmt: skip
"""Settings differ by as good as nothing, so that both results have a place."""


def peak_mb() -> float:
    """The peak of this process's resident memory, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def solve_here(job: SolveJob) -> tuple[str, float, float, float, float]:
    """State, seconds of the clock and of a core, and memory before and at its peak, of a solve in this process."""
    before, begun, taken = peak_mb(), time.monotonic(), time.process_time()
    outcome = solving.solve(job)
    state = f"{outcome.state} {outcome.detail}".strip()
    return state, time.monotonic() - begun, time.process_time() - taken, before, peak_mb()


def main() -> None:
    """Measures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--factor", type=int, default=72, help="size of the images, in those of 48 × 48 pixels")
    factor: int = parser.parse_args().factor
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        archive = Archive.create(str(folder / "archive"))
        made = session_copies.enlarge(session_copies.make(folder / "20261121-190041-000001", 1, results=False), factor)
        begun = time.monotonic()
        key = archive.push(made).key
        facts, stored = archive.session(key).facts, archive.session(key).bytes
        pixels = facts.width * facts.height
        print(f"{facts.width} × {facts.height} pixels, {facts.lights} lights: {stored / 1e6:.0f} MB, "
              f"pushed in {time.monotonic() - begun:.1f} s", flush=True)  # fmt: skip
        jobs = {
            what: SolveJob(
                archive.address, archive.catalogue_address, key, SolveIdentity(settings=settings), version("lightpose"),
                what, ONE_PIECE if what == "one process" else IN_TILES,
            )
            for what, settings in SETTINGS.items()
        }  # fmt: skip
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            state, seconds, taken, before_mb, peak = pool.apply(solve_here, (jobs["one process"],))
        print(f"one process, {os.cpu_count()} cores: {state}, {seconds:.1f} s, {taken:.1f} s of a core, "
              f"peak {peak:.0f} MB, before {before_mb:.0f} MB: {(peak - before_mb) * 1e6 / pixels:.0f} bytes a pixel",
              flush=True)  # fmt: skip
        with (
            LocalCluster(
                n_workers=2, threads_per_worker=1, env=distributed.worker_environment(1), dashboard_address=":0"
            ) as cluster,
            Client(cluster) as client,
        ):
            begun, taken = time.monotonic(), sum(client.run(time.process_time).values())
            outcome = client.submit(solving.solve, jobs["two workers"]).result()
            seconds = time.monotonic() - begun
            taken = sum(client.run(time.process_time).values()) - taken
            peaks = ", ".join(f"{peak:.0f}" for peak in client.run(peak_mb).values())
        print(f"two workers, one core each: {outcome.state}, {seconds:.1f} s, {taken:.1f} s of a core, "
              f"peaks {peaks} MB", flush=True)  # fmt: skip
        maps = []
        for what, job in jobs.items():
            entry = archive.result(result_name(key, version("lightpose"), job.identity.hash))
            archive.fetch(entry.files, folder / what)
            (result,) = (folder / what / "results").iterdir()
            maps.append(export.read(result))
        size = sum(file.bytes for file in entry.files.values())
        difference = max(
            float(np.nanmax(np.abs(getattr(maps[0], field) - getattr(maps[1], field))))
            for field in ("normals", "sigma_deg", "depth", "albedo")
        )
        print(f"a result has {size / 1e6:.1f} MB, {size / pixels:.1f} bytes a pixel; "
              f"largest difference of normals, σ, depth and albedo: {difference:g}")  # fmt: skip
        archive.close()


if __name__ == "__main__":
    main()
