"""The tool on the flange: the payload that the controller is told, and what is said where it is not known."""

import pytest
from pydantic import ValidationError

from acquisition.models import cell_config
from acquisition.models.cell_config import BoardConfig, CellConfig
from acquisition.waypoints import mounted_tool
from tests.acquisition.runner.simulated_rig import CELL_FILE

CELL = cell_config.load(CELL_FILE)
CENTER = (0.0, 0.01, 0.08)


def with_payload(mass_kg: float | None) -> CellConfig:
    board = mounted_tool.require_board(CELL)
    center = None if mass_kg is None else CENTER
    changed = board.model_copy(update={"payload_kg": mass_kg, "payload_center_m": center})
    return CELL.model_copy(update={"board": changed})


def test_payload_with_board_is_the_boards() -> None:
    cell = with_payload(0.9)
    assert mounted_tool.payload(cell, "board") == (0.9, CENTER)
    assert mounted_tool.with_tool(cell, "board").arm.payload_kg == 0.9
    assert mounted_tool.payload(cell, "lamp") == (CELL.arm.payload_kg, CELL.arm.payload_center_m)
    assert mounted_tool.payload_warning(cell, "board") == ""


def test_payload_not_stated_is_the_lamps_and_warns() -> None:
    assert mounted_tool.payload(with_payload(None), "board")[0] == CELL.arm.payload_kg
    assert "state payload_kg" in mounted_tool.payload_warning(with_payload(None), "board")
    assert mounted_tool.payload_warning(with_payload(None), "lamp") == ""


def test_payload_without_centre_is_refused() -> None:
    stated = mounted_tool.require_board(CELL).model_dump() | {"payload_kg": 0.9}
    with pytest.raises(ValidationError, match="belong together"):
        BoardConfig.model_validate(stated)


def test_fingerprint_without_payload_is_as_before() -> None:
    assert with_payload(None).fingerprint == CELL.fingerprint
    assert with_payload(0.9).fingerprint != CELL.fingerprint
