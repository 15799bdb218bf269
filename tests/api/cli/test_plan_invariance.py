"""`lightpose plan` does not depend on the unit of the images, nor on the order of images and candidates."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from acquisition import geometry
from acquisition.models.errors import ErrorCode, RigError
from api.cli import planning
from tests.acquisition.formats.folders import small


def planned(folder: Path, full_scale: float | None = None, **options: object) -> dict[str, object]:
    return planning.run(planning.plan_request(folder, 3, full_scale=full_scale, **options))  # type: ignore[arg-type]


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


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_plan_candidates_in_another_order_gives_the_same_lights(seed: int, tmp_path: Path) -> None:
    """The search exchanges single lights from random starts, and ends at the same set of these 30 lamps. Of more lights
    it may end at another set whose forecast is within 2 %."""
    folder, file = small.diligent(tmp_path / "in"), tmp_path / "dome.txt"
    slant, azimuth = np.radians(np.repeat([25.0, 50.0, 65.0], 10)), np.arange(30) * np.radians(137.5)
    lamps = geometry.direction(slant, azimuth)
    plans: list[dict[str, object]] = []
    for order in (np.arange(30), np.random.default_rng(seed).permutation(30)):
        np.savetxt(file, lamps[order])
        plan = planned(folder, candidates=file)
        plans.append(plan | {"lights": {int(order[light["number"]]) for light in plan["lights"]}})  # type: ignore[attr-defined]
    assert plans[0]["lights"] == plans[1]["lights"]
    assert plans[0]["forecast_mean_deg"] == pytest.approx(plans[1]["forecast_mean_deg"], rel=1e-6)


def test_plan_pilot_in_another_order_gives_the_same_forecast(usual: dict[str, object], tmp_path: Path) -> None:
    plan = planned(small.diligent(tmp_path, colour=False), pilot="5,0,3,2,4,1")
    assert plan["pilot"] == [5, 0, 3, 2, 4, 1]
    assert plan["forecast_mean_deg"] == pytest.approx(usual["forecast_mean_deg"], rel=1e-3)


@pytest.mark.parametrize("where", ["radius", "candidates"])
def test_plan_lights_within_the_object_are_refused(where: str, tmp_path: Path) -> None:
    """A ball of 40 mm whose top is 460 mm from the camera; the mean of its visible points is a centimetre below it."""
    folder, inside = small.near(tmp_path / "in"), tmp_path / "inside.txt"
    inside.write_text("0 0 465\n5 0 466\n0 5 466\n")
    options = {"radius_mm": 2.0} if where == "radius" else {"candidates": inside}
    with pytest.raises(RigError, match=r"none of the .* would light the object") as caught:
        planned(folder, **options)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
