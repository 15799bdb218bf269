"""Checks between stages: planning is refused where the measured object protrudes from the keep-out cylinder."""

from pathlib import Path

import pytest

from acquisition.formats import export
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.runner import jobs
from tests.acquisition import scenes, session_folder


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return session_folder.make(tmp_path_factory.mktemp("session")) / "results" / "1"


@pytest.fixture(scope="module")
def stored(result: Path) -> NormalMap:
    return export.read(result)


def cell_of(height_m: float) -> CellConfig:
    """The cell of the folder with another keep-out."""
    cell = session_folder.cell()
    keep_out = cell.object.keep_out.model_copy(update={"height_m": height_m})
    return cell.model_copy(update={"object": cell.object.model_copy(update={"keep_out": keep_out})})


def true_top_m() -> float:
    scene = session_folder.scene()
    return scenes.TABLE_DEPTH - float(scene.depth[scene.mask].min())


def test_require_within_keep_out_allows_half_the_clearance(stored: NormalMap) -> None:
    known, half = session_folder.calibration(), session_folder.cell().clearances.object_m / 2
    top_m = true_top_m()
    assert top_m > 0.02
    jobs.require_within_keep_out(stored, cell_of(top_m), known)
    jobs.require_within_keep_out(stored, cell_of(top_m - half + 0.008), known)
    with pytest.raises(RigError, match="keep_out") as caught:
        jobs.require_within_keep_out(stored, cell_of(max(top_m - half - 0.008, 0.001)), known)
    assert caught.value.code is ErrorCode.CONFIG_INVALID
    assert caught.value.context["measured_top_m"] == pytest.approx(top_m, abs=0.008)


def test_further_lights_object_above_keep_out_is_refused(result: Path, tmp_path: Path) -> None:
    known = session_folder.calibration()
    observations = scenes.capture(session_folder.scene(), session_folder.LIGHTS, exposure_s=0.05)
    with pytest.raises(RigError, match="Nothing was moved"):
        jobs.further_lights(Recipe(), cell_of(0.005), known, tmp_path / "reach.json", result, observations, None)
