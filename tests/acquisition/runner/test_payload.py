"""The controller's payload goes with the tool that is stated, and comes back."""

import time
from pathlib import Path

import pytest

from acquisition.models.cell_config import Tool
from acquisition.session_state import State, Trigger
from tests.acquisition.runner.simulated_rig import CELL_FILE, Rig, new, simulated_rig, wait_for

BOARD, LAMP = [0.9, 0.0, 0.01, 0.08], [0.6, 0.01, 0.0, 0.07]


def payload_after(rig: Rig, tool: Tool, expected: list[float]) -> list[float]:
    rig.runner.state_tool(tool, "a")
    deadline = time.monotonic() + 60
    while rig.control.state()["payload"] != pytest.approx(expected) and time.monotonic() < deadline:
        time.sleep(0.05)
    return rig.control.state()["payload"]


@pytest.mark.long
def test_payload_is_the_boards_while_it_is_mounted(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    stated = "replaces_lamp = false\npayload_kg = 0.9\npayload_center_m = [0.0, 0.01, 0.08]"
    file.write_text(CELL_FILE.read_text(encoding="utf-8").replace("replaces_lamp = false", stated), encoding="utf-8")
    with simulated_rig(tmp_path, "127.0.6.32", cell_file=file) as rig:
        assert payload_after(rig, "board", BOARD) == pytest.approx(BOARD)
        assert payload_after(rig, "lamp", LAMP) == pytest.approx(LAMP)
        session_id = new(rig)
        rig.runner.act(session_id, Trigger.START, "a")
        assert wait_for(rig, session_id, State.COMPLETED, State.FAILED) is State.COMPLETED
        assert rig.control.state()["payload"] == pytest.approx(LAMP)
