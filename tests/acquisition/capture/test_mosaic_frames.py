"""Checks of frames of a mosaic sensor, and of the camera's sites against the calibration's."""

import cv2
import numpy as np
import pytest

from acquisition import mosaic
from acquisition.capture import camera_fit, check
from acquisition.models.calibration import SensorModel
from acquisition.models.camera import CameraCapabilities
from acquisition.models.camera_config import PylonCameraConfig
from acquisition.models.colour import Mosaic, mosaic_of
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure
from hardware_sim import sensor as sensors
from tests.acquisition import scenes

SIZE = 96
WHITE = np.array([0.9, 1.2, 0.7])
MONO = scenes.calibration(SIZE).sensor
BAYER = MONO.model_copy(update={"mosaic": "rggb"})
REGION = np.ones((SIZE, SIZE), bool)


def _frame(sharp: bool, sensor: SensorModel) -> np.ndarray:
    """A textured grey scene, sharp or blurred by 1.5 pixels, with noise; through the sensor's sites."""
    random = np.random.default_rng(4)
    scene = 0.4 + 0.15 * cv2.GaussianBlur(random.standard_normal((SIZE, SIZE)), (0, 0), 1.0) * 3
    scene = scene if sharp else cv2.GaussianBlur(scene, (0, 0), 3.0)
    if sensor.mosaic is not None:
        scene = scene * WHITE[mosaic.sites(sensor.mosaic, slice(0, SIZE), slice(0, SIZE))]
    return sensors.expose(np.clip(scene, 0, 0.8).astype(np.float32), sensor, random)


def test_sharpness_of_a_mosaic_sees_detail_and_not_the_pattern() -> None:
    sharp, blurred = (check.sharpness(_frame(one, BAYER), REGION, BAYER) for one in (True, False))
    assert sharp is not None
    assert blurred is None or blurred < 0.5 * sharp
    # Taken for a monochrome sensor's, the pattern hides the blur.
    pattern = [check.sharpness(_frame(one, BAYER), REGION, MONO) for one in (True, False)]
    assert pattern[0] is not None
    assert pattern[1] is not None
    assert pattern[1] > 0.8 * pattern[0]


def test_lit_frame_of_a_mosaic_is_judged_by_its_brightest_channel() -> None:
    pixels = np.full((SIZE, SIZE), 1000, np.uint16)
    pixels[1::2, 1::2] = 3000  # blue sites, a quarter of all; in the lower half 2000
    pixels[SIZE // 2 + 1 :: 2, 1::2] = 2000
    level = check.lit_frame(pixels, REGION, BAYER, 0.01, Exposure(), scenes_camera()).quality.bright_level
    assert level == pytest.approx((3000 - BAYER.black_level_dn) / BAYER.full_scale_dn, abs=1e-3)


def scenes_camera() -> PylonCameraConfig:
    return PylonCameraConfig(kind="pylon", serial="1")


@pytest.mark.parametrize(
    ("pixel_format", "pattern"),
    [("BayerRG12", "rggb"), ("BayerGR8", "grbg"), ("BayerGB16", "gbrg"), ("BayerBG10", "bggr"), ("Mono12", None)],
)
def test_mosaic_of_a_pixel_format_is_genicams(pixel_format: str, pattern: Mosaic | None) -> None:
    assert mosaic_of(pixel_format) == pattern


@pytest.mark.parametrize(("camera", "calibrated"), [("rggb", None), (None, "rggb"), ("grbg", "rggb")])
def test_require_fit_of_other_sites_names_both(camera: Mosaic | None, calibrated: Mosaic | None) -> None:
    known = scenes.calibration(SIZE)
    known = known.model_copy(update={"sensor": known.sensor.model_copy(update={"mosaic": calibrated})})
    told = CameraCapabilities(
        name="one", width=SIZE, height=SIZE, bits=12, triggers=("software",), min_exposure_s=1e-5, max_exposure_s=10.0,
        mosaic=camera,
    )  # fmt: skip
    said = f"{camera or 'monochrome'}, but the calibration's is {calibrated or 'monochrome'}"
    with pytest.raises(RigError, match=said) as no:
        camera_fit.require_fit(told, known, scenes_camera())
    assert no.value.code is ErrorCode.CONFIG_INVALID
    same = told.model_copy(update={"mosaic": calibrated})
    assert camera_fit.require_fit(same, known, scenes_camera()) == []
