"""Reads linear pixels from an image file of a camera or a tethering program; a truncated file is refused.

TIFF and PNG hold what was saved: whoever sets up the program must make it save linear values. A RAW file (DNG, NEF,
CR3, …) is read without development: the sensor's own values through LibRaw, black level included, no white balance, no
demosaicing, no curve. If the cell file states the sensor's mosaic, all its sites are kept. Otherwise the green sites
are averaged over each 2 × 2 cell: half the size, one channel.
"""

import importlib
import io
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

from acquisition.models.colour import Mosaic
from acquisition.models.errors import ErrorCode, RigError

RAW_SUFFIXES = frozenset({".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".iiq", ".3fr"})
EXPOSURE_TIME = 33434
"""Number of the EXIF tag ExposureTime."""

_JPEG_START = b"\xff\xd8\xff"
_PNG_START = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class ImageFile:
    """Linear pixels (H, W) uint16; the exposure time, s, that the file states, or None."""

    pixels: npt.NDArray[np.uint16]
    exposure_s: float | None = None
    bits: int = 16


class IncompleteFileError(Exception):
    """A file that is not complete (yet), with what is missing."""


def read(path: Path, mosaic: Mosaic | None = None) -> ImageFile:
    """Reads a file by its suffix; `mosaic` is that of the sensor whose sites are kept.

    Raises IncompleteFileError for a truncated or damaged file; RigError config.invalid for a kind without linear pixels
    (JPEG), for colour if one channel is needed, and for RAW without rawpy.
    """
    suffix = path.suffix.lower()
    if suffix in RAW_SUFFIXES:
        try:
            return read_raw(path.read_bytes(), path.name, mosaic)
        except OSError as error:
            raise IncompleteFileError(f"{path.name}: {error}") from error
    if suffix in {".tif", ".tiff"}:
        return _tiff(path)
    if suffix == ".png":
        return _png(path)
    raise RigError(
        ErrorCode.CONFIG_INVALID,
        f"{path.name}: files of this kind hold no linear pixels; save TIFF or PNG of 16 bits, or RAW",
    )


def _tiff(path: Path) -> ImageFile:
    try:
        with tifffile.TiffFile(path) as file:
            page: Any = file.pages[0]
            pixels = np.asarray(page.asarray())
            exif: Any = page.tags.get("ExifTag")
            exposure: Any = None if exif is None else exif.value.get("ExposureTime")
            own: Any = page.tags.get(EXPOSURE_TIME)
            exposure = own.value if exposure is None and own is not None else exposure
    except (OSError, ValueError, IndexError, struct.error, tifffile.TiffFileError, zlib.error) as error:
        raise IncompleteFileError(f"{path.name}: {error}") from error
    return ImageFile(_single(path, pixels), _seconds(exposure), 8 * pixels.dtype.itemsize)


def _png(path: Path) -> ImageFile:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise IncompleteFileError(f"{path.name}: {error}") from error
    if not content.startswith(_PNG_START) or content[-8:-4] != b"IEND":
        raise IncompleteFileError(f"{path.name}: its end is missing")
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise IncompleteFileError(f"{path.name}: cannot be decoded")
    return ImageFile(_single(path, pixels), None, 8 * pixels.dtype.itemsize)


def read_raw(content: bytes, name: str, mosaic: Mosaic | None = None) -> ImageFile:
    """Returns the sensor's own values from a RAW file's bytes; all sites of a sensor whose `mosaic` is stated.

    Raises IncompleteFileError for a truncated file; RigError config.invalid for a JPEG, for a mosaic other than the
    stated one or Bayer's, and without rawpy.
    """
    if content.startswith(_JPEG_START):
        raise RigError(
            ErrorCode.CONFIG_INVALID, f"{name} is a JPEG, which holds no linear pixels: set the camera to RAW only"
        )
    try:
        rawpy: Any = importlib.import_module("rawpy")
    except ImportError as error:
        detail = f"{name} is a RAW file, but rawpy is missing: install the extra `dslr`"
        raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
    try:
        with rawpy.imread(io.BytesIO(content)) as raw:
            pixels = np.array(raw.raw_image_visible, dtype=np.uint16)
            sites = np.array(raw.raw_colors_visible)
            names, white = bytes(raw.color_desc), int(raw.white_level)
            exposure = float(getattr(getattr(raw, "other", None), "shutter", 0.0) or 0.0)
    except (OSError, rawpy.LibRawError) as error:
        raise IncompleteFileError(f"{name}: {error}") from error
    bits = max(white.bit_length(), 1)
    letters = "".join(chr(names[number]) for number in sites[:2, :2].ravel()).lower()
    monochrome = sites.max(initial=0) == 0  # only one kind of site
    if mosaic is not None and (monochrome or letters != mosaic):
        found = "monochrome" if monochrome else f"a mosaic of {letters}"
        raise RigError(ErrorCode.CONFIG_INVALID, f"{name}: is {found}, the cell file says {mosaic}: correct `mosaic`")
    if monochrome or mosaic is not None:
        return ImageFile(pixels, exposure or None, bits)
    green = np.isin(sites, [index for index, name in enumerate(names) if name == ord("G")])
    return ImageFile(_green(name, pixels, green), exposure or None, bits)


def _green(name: str, pixels: npt.NDArray[np.uint16], green: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint16]:
    """Returns the mean of the two green sites of each 2 × 2 cell, (H / 2, W / 2)."""
    height, width = (side // 2 for side in pixels.shape)
    values = np.where(green, pixels, 0)[: 2 * height, : 2 * width].reshape(height, 2, width, 2).sum((1, 3), np.uint32)
    count = green[: 2 * height, : 2 * width].reshape(height, 2, width, 2).sum((1, 3))
    if not (count == 2).all():
        raise RigError(
            ErrorCode.CONFIG_INVALID, f"{name}: its mosaic is not a Bayer mosaic, the only kind that can be read"
        )
    return ((values + 1) // 2).astype(np.uint16)


def _single(path: Path, pixels: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
    if pixels.ndim != 2 or pixels.dtype.str[1:] not in ("u1", "u2"):
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"{path.name}: has shape {pixels.shape} of {pixels.dtype}: save one channel of 8 or 16 bits",
        )
    return pixels.astype(np.uint16)


def _seconds(value: Any) -> float | None:
    """Converts an EXIF number, which is a number or a pair of numerator and denominator."""
    if value is None:
        return None
    if isinstance(value, tuple):
        above, below = float(value[0]), float(value[1])
        return above / below if below > 0 else None
    return float(value)
