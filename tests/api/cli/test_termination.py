"""`lightpose solve` and `plan` that are ended from outside, as by the time limit of a batch system."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.acquisition.formats.folders import small

ROOT = Path(__file__).parents[3]
PROGRAM = """
import signal, sys, time
from acquisition.formats import folders
from api.cli.commands import app

def read(folder, scratch, **_):
    (scratch / "0.raw").write_bytes(bytes(1000))
    print("reading", flush=True)
    time.sleep(60)

folders.read = read
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it is ignored
app(sys.argv[1:])
"""
"""The command line, whose reader unpacks a file and then takes its time."""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
@pytest.mark.parametrize(
    "options", [("solve", "--out", "out/normals"), ("plan", "--count", "1")], ids=lambda one: one[0]
)
def test_command_that_is_ended_leaves_no_unpacked_images(
    options: tuple[str, ...], number: signal.Signals, status: int, tmp_path: Path
) -> None:
    folder, scratch = small.lp(tmp_path / "in"), tmp_path / "scratch"
    scratch.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, options[0], str(folder), *options[1:]],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(scratch)},
    ) as running:  # fmt: skip
        assert running.stdout is not None
        assert running.stdout.readline() == "reading\n"
        assert len(list(tmp_path.rglob("*.raw"))) == 1
        running.send_signal(number)
        assert running.wait(30) == status
    assert not list(tmp_path.rglob("*.raw"))
    assert {path.name for path in tmp_path.rglob("*") if folder not in path.parents} <= {"in", "out", "scratch"}
