"""`lightpose calibrate colour` on folders of images of the simulated chart."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from acquisition.calibrate.chart_reference import published
from acquisition.models.calibration import Calibration
from api.cli.commands import app
from hardware_sim import spectra
from tests.acquisition import scenes
from tests.acquisition.calibrate import chart_images
from tests.acquisition.calibrate.chart_images import SENSOR

SIZE = 320


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One image with its lamp-off image, a base calibration, and the simulated chart's reference values."""
    made = tmp_path_factory.mktemp("chart")
    tifffile.imwrite(made / "one.tiff", chart_images.frame(0, SIZE))
    random = np.random.default_rng(0)
    off = np.rint(SENSOR.black_level_dn + 2 * random.standard_normal((SIZE, SIZE)))
    tifffile.imwrite(made / "off.tiff", off.astype(np.uint16))
    (made / "colour.csv").write_text("image,lamp off\none.tiff,off.tiff\n")
    lines = [",".join([name, *map(str, lab)]) for name, lab in zip(published().names, spectra.chart_lab(), strict=True)]
    (made / "reference.csv").write_text("name,L,a,b\n" + "\n".join(lines))
    base = scenes.calibration(SIZE).model_copy(update={"sensor": SENSOR})
    (made / "base.json").write_text(base.model_dump_json())
    return made


def calibrated(folder: Path, *more: object) -> tuple[int, str]:
    arguments = ["calibrate", "colour", folder, "--base", folder / "base.json", *more]
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.output


def test_calibrate_colour_writes_colour_into_the_calibration(folder: Path, tmp_path: Path) -> None:
    reference = ("--reference", folder / "reference.csv")
    code, said = calibrated(folder, *reference, "--out", tmp_path / "out", "--json")
    assert code == 0, said
    found = json.loads(said.strip().splitlines()[-1])
    assert found["colour"]["delta_e_mean"] < 1.2
    assert len(found["patches"]) == 24
    assert set(found["images"]) == {"one.tiff", "off.tiff"}
    written = Calibration.model_validate_json((tmp_path / "out" / "calibration.json").read_bytes())
    assert written.colour is not None
    assert written.colour.delta_e_max == pytest.approx(found["colour"]["delta_e_max"])
    assert written.sensor.mosaic == "rggb"
    again, refusal = calibrated(folder, *reference, "--out", tmp_path / "out")
    assert again != 0
    assert "is not overwritten" in refusal.replace("\n", " ")


def test_calibrate_colour_of_a_monochrome_base_asks_for_the_mosaic(folder: Path, tmp_path: Path) -> None:
    base = tmp_path / "mono.json"
    base.write_text(scenes.calibration(SIZE).model_dump_json())
    done = CliRunner().invoke(
        app, ["calibrate", "colour", str(folder), "--base", str(base), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code != 0
    assert "sensor.mosaic" in done.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("corners", ["1,2 3,4", "a,b c,d e,f g,h", "0,0 9,9 9,0 0,9"])
def test_calibrate_colour_with_bad_corners_is_refused(corners: str, folder: Path, tmp_path: Path) -> None:
    code, said = calibrated(folder, "--corners", corners, "--out", tmp_path / "out")
    assert code != 0
    assert "corners" in said
    assert not (tmp_path / "out").exists()
