"""Encoding of frames for display: 8 bits with a gamma, so that shadows can be seen.

The stored frames remain linear and 16-bit. The encoded pictures serve for display only.
"""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

from acquisition import mosaic
from acquisition.models.calibration import SensorModel
from acquisition.models.errors import ErrorCode, RigError

GAMMA = 2.2
JPEG_QUALITY = 85
MAX_SIDE_PX = 1280
"""Longest side of a JPEG, px. A browser's window does not show more pixels than that."""

MAX_GAIN = 16.0
"""Largest gain of a JPEG. A dark frame that needs more shows only noise."""

Pixels = npt.NDArray[np.uint16]


def png(path: Path, sensor: SensorModel) -> bytes:
    """Encodes a stored frame (linear 16-bit TIFF) as an 8-bit PNG from black level to full scale, gamma 2.2.

    The scale is that of the sensor, not of the frame, so that the pictures of one session can be compared. Raises
    RigError store.corrupt when the file is missing or damaged.
    """
    return _encoded(".png", _lookup_table(sensor, 1.0)[_shown(read_frame(path), sensor)], [])


def jpeg(pixels: Pixels, sensor: SensorModel) -> bytes:
    """Encodes a frame (H, W, uint16, linear) as a JPEG of at most `MAX_SIDE_PX`, gamma 2.2, 99.5th percentile white."""
    bright = (float(np.percentile(pixels, 99.5)) - sensor.black_level_dn) / sensor.full_scale_dn
    picture = _lookup_table(sensor, float(np.clip(1 / max(bright, 1e-6), 1.0, MAX_GAIN)))[_shown(pixels, sensor)]
    return _jpeg(picture, MAX_SIDE_PX / max(picture.shape))


def thumbnail(pixels: Pixels, sensor: SensorModel, width: int) -> bytes:
    """Encodes a frame (H, W, uint16, linear) as a JPEG of at most `width` px, on the same scale as `png`."""
    return _jpeg(_lookup_table(sensor, 1.0)[_shown(pixels, sensor)], width / pixels.shape[1])


def small(picture: npt.NDArray[np.uint8], width: int) -> bytes:
    """Encodes an 8-bit picture (H, W) or (H, W, 3) as a JPEG of at most `width` px."""
    return _jpeg(picture, width / picture.shape[1])


def read_frame(path: Path) -> Pixels:
    """Reads a stored frame (H, W). Raises RigError store.corrupt when the file is missing or damaged."""
    try:
        return tifffile.imread(path)
    except (OSError, ValueError, tifffile.TiffFileError) as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error}", file=path.name) from error


def _shown(pixels: Pixels, sensor: SensorModel) -> Pixels:
    """Returns the frame (H, W), of a mosaic sensor its balanced mean, which removes the mosaic pattern."""
    if sensor.mosaic is None:
        return pixels
    return np.rint(mosaic.balanced_mean(pixels.astype(np.float32))).astype(np.uint16)


def _lookup_table(sensor: SensorModel, gain: float) -> npt.NDArray[np.uint8]:
    """Returns the 8-bit value of each 16-bit value, (65536,)."""
    signal = np.clip(gain * (np.arange(65536) - sensor.black_level_dn) / sensor.full_scale_dn, 0, 1)
    return np.round(255 * signal ** (1 / GAMMA)).astype(np.uint8)


def _jpeg(picture: npt.NDArray[np.uint8], scale: float) -> bytes:
    """Encodes a picture (H, W) or (H, W, 3) as a JPEG, shrunk by `scale` if that is below 1."""
    if scale < 1:
        height, width = picture.shape[:2]
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    return _encoded(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def _encoded(suffix: str, picture: npt.NDArray[np.uint8], settings: list[int]) -> bytes:
    written, encoded = cv2.imencode(suffix, picture, settings)
    if not written:
        raise RigError(ErrorCode.SERVICE_FAULT, f"A picture of shape {picture.shape} cannot be written as {suffix}")
    return encoded.tobytes()
