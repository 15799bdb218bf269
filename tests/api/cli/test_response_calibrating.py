"""`lightpose calibrate response` on a folder: files with values, nothing overwritten, the wrong line named."""

from pathlib import Path

import cv2
import pytest

from acquisition.models.calibration_result import ResponseResult
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import write_value
from api.cli.response_calibrating import RESPONSE_FILE, calibrate_response
from hardware_sim import nominal
from tests.acquisition.calibrate import simulated_response as simulated


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made, sensor = tmp_path_factory.mktemp("response"), simulated.sensor_of(0)
    lines = ["image,lamp,exposure_s,taken_s"]
    for frame in simulated.frames(0, sensor, count=25):
        name = frame.name.replace(".tiff", ".png")
        cv2.imwrite(str(made / name), frame.read())
        lines.append(f"{name},{'on' if frame.lit else 'off'},{frame.exposure_s},{frame.taken_at}")
    (made / RESPONSE_FILE).write_text("\n".join(lines), encoding="utf-8")
    base = nominal.calibration(128).model_copy(update={"width": simulated.SIZE[1], "height": simulated.SIZE[0]})
    write_value(made / "base.json", base)
    return made


def test_calibrate_response_writes_values_and_no_file_twice(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibrate_response(folder, folder / "base.json", tmp_path / "out")
    said = capsys.readouterr().err.replace("\n", " ")
    assert "in the cell file to use it" in said
    assert "/v1/rig/calibrations/active" not in said
    found = ResponseResult.model_validate_json((tmp_path / "out" / "response.json").read_bytes())
    assert found.gain_e_per_dn == pytest.approx(simulated.sensor_of(0).gain_e_per_dn, rel=0.05)
    assert (tmp_path / "out" / "photon_transfer.png").exists()
    with pytest.raises(RigError, match="is not overwritten"):
        calibrate_response(folder, folder / "base.json", tmp_path / "out")


def test_calibrate_response_names_the_wrong_line(folder: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "images"
    wrong.mkdir()
    (wrong / RESPONSE_FILE).write_text("image,lamp,exposure_s\n1.png,glowing,0.1\n", encoding="utf-8")
    with pytest.raises(RigError, match="line 2: lamp must be on or off") as refused:
        calibrate_response(wrong, folder / "base.json", tmp_path / "out")
    assert refused.value.code is ErrorCode.FOLDER_INVALID
    assert not (tmp_path / "out").exists()
