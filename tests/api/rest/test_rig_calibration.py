"""The calibration in use over HTTP: complete, dated, named, and the same to whoever compares it."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import load_calibration
from api.rest import settings
from tests.api.conftest import NOBODY, SERVICE, Running, serve, write_cell


def test_calibration_fingerprint_depends_on_values_alone(cell_file: Path) -> None:
    known = load_calibration(cell_file.parent / "calibration.sim.json")
    again = Calibration.model_validate_json(known.model_dump_json(indent=7))
    assert again.fingerprint == known.fingerprint
    assert known.model_copy(update={"lobe_exponent": 0.9}).fingerprint != known.fingerprint


def test_rig_calibration_states_values_source_and_age(shared: Running) -> None:
    stated = shared.client.calibration()
    cell = shared.settings.cell
    assert cell is not None
    known = load_calibration(cell.parent / stated.file)
    assert stated.values == known
    assert stated.fingerprint == known.fingerprint
    age = datetime.now(UTC) - datetime.fromisoformat(known.made_at)
    assert stated.age_days == pytest.approx(age / timedelta(days=1), abs=0.1)
    assert stated.valid == shared.client.rig().calibration.valid
    assert shared.client.rig().links["calibration"] == stated.links["self"]


def test_rig_calibration_out_of_date_is_stated(tmp_path: Path) -> None:
    cell = write_cell(tmp_path / "cell", NOBODY)
    file = cell.parent / "calibration.sim.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"made_at": "2020-01-01T00:00:00Z", "valid_days": 30.0}))
    with serve(settings.read(cell=cell, data=tmp_path / "data", host=SERVICE, port=0)) as old:
        stated = old.client.calibration()
    assert not stated.valid
    assert stated.age_days > 2000
    assert stated.valid_until.startswith("2020-01-31")
