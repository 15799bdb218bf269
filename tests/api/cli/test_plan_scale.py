"""`lightpose plan` of the same images in files of another scale: the plan is the same."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from api.cli import planning
from tests.acquisition.formats.folders import small


def planned(folder: Path, full_scale: float | None = None) -> dict[str, object]:
    return planning.run(planning.plan_request(folder, 3, full_scale=full_scale))


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """The plan for images that fill the range of their 16-bit files."""
    return planned(small.diligent(tmp_path_factory.mktemp("usual") / "folder", colour=False))


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_plan_images_of_fewer_bits_is_that_of_16_bits(bits: int, usual: dict[str, object], tmp_path: Path) -> None:
    """Expected images saturate at the stated full scale. Rounding to 10 bits adds a noise of 0.03 %."""
    folder, top = small.diligent(tmp_path, colour=False), 2**bits - 1
    for path in folder.glob("0*.png"):
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * (top / 65535)
        cv2.imwrite(str(path), np.round(values).astype(np.uint16))
    plan = planned(folder, float(top))
    assert plan["forecast_mean_deg"] == pytest.approx(usual["forecast_mean_deg"], rel=0.05)
    assert plan["efficiency"] == pytest.approx(usual["efficiency"], rel=0.05)


def in_floats(folder: Path, factor: float) -> Path:
    """Converts a folder's images to float32 files of fractions of full scale times a factor."""
    for path in folder.glob("0*.png"):
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32)
        tifffile.imwrite(path.with_suffix(".tiff"), values * np.float32(factor / 65535))
    names = folder / "filenames.txt"
    names.write_text(names.read_text().replace(".png", ".tiff"))
    return folder


def test_plan_merged_exposures_do_not_depend_on_their_unit(tmp_path: Path) -> None:
    """No full scale is known of float images with values above 1: planned images are exposed as they are. Factors that
    are powers of two change no rounding."""
    plans = [planned(in_floats(small.diligent(tmp_path / f"{one}", colour=False), one)) for one in (4.0, 1024.0)]
    assert plans[0]["lights"] == plans[1]["lights"]
    assert plans[0]["forecast_mean_deg"] == pytest.approx(plans[1]["forecast_mean_deg"], rel=1e-4)


@pytest.mark.parametrize("full_scale", [2.0, 16.0])
def test_plan_floats_of_stated_full_scale_have_no_steps(
    full_scale: float, usual: dict[str, object], tmp_path: Path
) -> None:
    folder = in_floats(small.diligent(tmp_path, colour=False), full_scale)
    plan = planned(folder, full_scale)
    assert plan["forecast_mean_deg"] == pytest.approx(usual["forecast_mean_deg"], rel=0.05)
