"""Pictures of frames of a mosaic sensor: without the pattern of its sites."""

from pathlib import Path

import cv2
import numpy as np
import tifffile

from acquisition import mosaic
from api.rest import image_encoding
from tests.acquisition import scenes

SIZE = 64
SENSOR = scenes.calibration(SIZE).sensor.model_copy(update={"mosaic": "gbrg"})


def test_pictures_of_an_even_surface_are_even(tmp_path: Path) -> None:
    whole = slice(0, SIZE)
    frame = np.array([1000, 2400, 600], np.uint16)[mosaic.sites("gbrg", whole, whole)]
    tifffile.imwrite(tmp_path / "frame.tiff", frame)
    for content in (
        image_encoding.png(tmp_path / "frame.tiff", SENSOR),
        image_encoding.jpeg(frame, SENSOR),
        image_encoding.thumbnail(frame, SENSOR, 32),
    ):
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.ptp(picture) <= 1  # rounding
    plain = image_encoding.png(tmp_path / "frame.tiff", SENSOR.model_copy(update={"mosaic": None}))
    assert np.ptp(cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)) > 50
