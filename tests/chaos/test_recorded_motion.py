"""The check of the record finds motion that nobody had asked for."""

from pathlib import Path

import numpy as np

from hardware_sim.controller.trace import MAGIC
from tests.chaos.recorded_motion import BRAKES_WITHIN_S, AllowedMotion
from tests.load.loaded_cell import ROW


def append(record: Path, times: list[float], first_joint: list[float]) -> None:
    rows = np.zeros(len(times), dtype=ROW)
    rows["time"] = times
    rows["joints"][:, 0] = first_joint
    with record.open("ab") as file:
        file.write(rows.tobytes())


def test_recorded_motion_outside_the_allowed_intervals_is_found(tmp_path: Path) -> None:
    record = tmp_path / "ticks.bin"
    record.write_bytes(MAGIC)
    motion = AllowedMotion(record)
    append(record, [0.0, 0.002], [0.0, 0.0])
    assert motion.unasked() == []
    motion.begin()
    append(record, [1.5, 1.502], [0.1, 0.2])
    assert motion.unasked() == []
    motion.end()
    braked = 1.502 + BRAKES_WITHIN_S
    append(record, [1.504, braked, braked + 0.1, braked + 0.2], [0.2, 0.3, 0.3, 0.4])
    assert motion.unasked() == [braked + 0.2]
    assert motion.unasked() == []


def test_recorded_motion_of_a_controller_that_begins_anew_is_found(tmp_path: Path) -> None:
    record = tmp_path / "ticks.bin"
    record.write_bytes(MAGIC)
    motion = AllowedMotion(record)
    motion.begin()
    append(record, [100.0, 100.002], [0.0, 0.1])
    motion.end()
    append(record, [100.004, 0.0, 0.5, 1.5, 1.502], [0.1, 0.2, 0.2, 0.2, 0.3])

    assert motion.unasked() == [1.502]
