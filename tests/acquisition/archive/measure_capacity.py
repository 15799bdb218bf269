"""Memory that grows with an archive, and hashing: `python -m tests.acquisition.archive.measure_capacity`.

Two commands hold something of every session: `archive solve` its key and job, and of those that are solved their row,
`archive verify` the names of every file. Prints Python's memory (tracemalloc) for each, as the slope between a small
and a larger archive, and the bytes hashed in a second of a core. With PostgreSQL's figures (`measure_catalogue`) and
those of large captures (`measure_large`) these are the constants of docs/explanation/archive-capacity.md.
"""

import hashlib
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

from acquisition.archive import distributed
from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import result, session
from acquisition.archive.contents import BLOCK_BYTES
from acquisition.archive.entries import FileEntry, SessionEntry, SessionFacts, SolveIdentity, session_name
from acquisition.archive.solving import SolveJob

ROWS = (2_000, 22_000)
SESSIONS, FILES = (5, 85), 24
HASHED_BYTES = 1 << 30


def peak_bytes(work: Callable[[], object]) -> int:
    """The peak of Python's memory during a call, bytes."""
    tracemalloc.start()
    work()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def facts(number: int) -> SessionFacts:
    return SessionFacts(
        session_id=f"20261121-190041-{number:06x}", object="vase", notes="", cell="cell 1", kind="capture",
        method="near", lights=16, width=4096, height=3072, captured_at=1.7e9 + number, calibration="c", software="0.2",
    )  # fmt: skip


def caller(folder: Path, rows: int) -> int:
    """Peak, bytes, of the process that solves an archive with so many sessions, all of them done by another call."""
    archive = Archive.create(str(folder / f"rows{rows}"))
    identity = SolveIdentity()
    keys = [hashlib.sha256(str(number).encode()).hexdigest() for number in range(rows)]
    told = [facts(number).model_dump() | {"key": key, "bytes": 1, "pushed_at": 0.0} for number, key in enumerate(keys)]
    solved = {"solver": "0.2", "settings": identity.hash, "state": "done", "origin": "archive", "call": "other"}
    done = [solved | {"session": key, "attempts": 1, "finishes": 1} for key in keys]
    archive.catalogue.repeatedly(lambda connection: connection.execute(session.insert(), told).close())
    archive.catalogue.repeatedly(lambda connection: connection.execute(result.insert(), done).close())

    def work() -> None:
        wanted = archive.catalogue.selected_keys(session.c.kind == "capture")
        jobs = [SolveJob(archive.address, archive.catalogue_address, key, identity, "0.3", "call") for key in wanted]
        distributed.report(archive, wanted, "0.2", identity.hash, "call")
        assert len(jobs) == rows

    peak = peak_bytes(work)
    archive.close()
    return peak


def verifier(folder: Path, sessions: int) -> int:
    """Peak, bytes, of the process that verifies an archive of so many sessions of `FILES` files each."""
    archive = Archive.create(str(folder / f"files{sessions}"))
    for number in range(sessions):
        files: dict[str, FileEntry] = {}
        for shot in range(FILES):
            content = f"{number} {shot}".encode()
            digest = hashlib.sha256(content).hexdigest()
            archive.contents.write(f"objects/{digest[:2]}/{digest}", content)
            files[f"passes/0/shots/{shot}.tiff"] = FileEntry(sha256=digest, bytes=len(content))
        entry = SessionEntry(facts=facts(number), files=files)
        archive.contents.write(session_name(entry.key), entry.model_dump_json().encode())
    found: list[object] = []
    peak = peak_bytes(lambda: found.extend(archive.verify()))
    assert found == []
    archive.close()
    return peak


def main() -> None:
    """Measures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small, large = (caller(folder, rows) for rows in ROWS)
        print(f"solve: {(large - small) / (ROWS[1] - ROWS[0]):.0f} bytes a session in the process that calls")
        small, large = (verifier(folder, sessions) for sessions in SESSIONS)
        print(f"verify: {(large - small) / (SESSIONS[1] - SESSIONS[0]) / FILES:.0f} bytes a file")
    block, found = bytes(BLOCK_BYTES), hashlib.sha256()
    begun = time.process_time()
    for _ in range(HASHED_BYTES // BLOCK_BYTES):
        found.update(block)
    print(f"SHA-256: {HASHED_BYTES / (time.process_time() - begun) / 1e9:.2f} GB in a second of a core")


if __name__ == "__main__":
    main()
