"""A cell, a service on a disk and with a clock of its own, and what watches both."""

import shutil
import subprocess
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.chaos.event_follower import EventFollower
from tests.chaos.fault_schedule import Scene
from tests.chaos.recorded_motion import AllowedMotion
from tests.crash.crashing import SPEED, bench, small_disk

STEPPED_CLOCK = Path(__file__).with_name("stepped_clock.c")


@contextmanager
def scene(folder: Path, address: str, speed: float = SPEED, disk_mb: int = 1024) -> Generator[Scene]:
    """A running scene in an empty folder. Without a C compiler its clock cannot be stepped.

    Raises OSError where no file system may be mounted, for a full disk has to be a small one.
    """
    data, record, clock = folder / "data", folder / "ticks.bin", folder / "clock"
    environment: dict[str, str] = {}
    if shutil.which("gcc"):
        clock.write_bytes(bytes(8))
        library = folder / "stepped_clock.so"
        subprocess.run(["gcc", "-shared", "-fPIC", "-O2", "-o", str(library), str(STEPPED_CLOCK)], check=True)
        environment = {"LD_PRELOAD": str(library), "LIGHTPOSE_TEST_CLOCK": str(clock)}
    with ExitStack() as stack:
        stack.enter_context(small_disk(data, disk_mb))
        made = stack.enter_context(bench(folder, address, data, record, environment, speed))
        motion = AllowedMotion(record)
        motion.unasked()  # the undisturbed sessions are over
        events = stack.enter_context(EventFollower(lambda: made.service and made.service.url))
        yield Scene(made, motion, events, clock if environment else None)
