"""Writing of PNG pictures and float TIFF maps, each with its convention in the file's own metadata.

OpenCV writes no text into PNG files, so a tEXt chunk is inserted after the header.
"""

import struct
import zlib
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tifffile
from PIL import ImageCms

from acquisition import colour
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.result import NormalMap
from acquisition.normals.images.colour_albedo import SRGB
from acquisition.normals.images.normalised_images import row_blocks

Green = Literal["opengl", "directx"]
WHITE_QUANTILE = 0.995
"""Quantile of a grey or uncalibrated albedo that is white in the PNG: its scale may be unknown."""

FRAME = "view frame: x right, y up, z to the camera; row 0 at the top"
COLOURS = {
    "opengl": f"colour = (n + 1) / 2, OpenGL green (+Y up); {FRAME}",
    "directx": f"colour = (n + 1) / 2 with y inverted, DirectX green (+Y down); {FRAME}",
}


def depth_unit(normal_map: NormalMap) -> str:
    """The unit of a result's depth, as its solver noted it: m, pixel, or relative where no scale is known."""
    return str(normal_map.notes.get("depth_unit", "m"))


def normals_png(path: Path, normals: Float32Array, mask: BoolArray, green: Green = "opengl") -> None:
    """Writes normals (H, W, 3) as a 16-bit RGB normal map, black outside the mask (H, W)."""
    scale = np.array([32767.5, 32767.5 if green == "opengl" else -32767.5, 32767.5], np.float32)
    colours = np.empty(normals.shape, np.uint16)
    for rows in row_blocks(len(normals)):
        encoded = np.clip(normals[rows] * scale + np.float32(32768.0), 0, 65535)  # truncation after + ½ rounds
        colours[rows] = encoded[..., ::-1]  # OpenCV's order, B G R
    colours[~mask] = 0
    _write(path, colours, COLOURS[green])


def is_srgb(normal_map: NormalMap) -> bool:
    """Whether the colours of the albedo are those of linear sRGB."""
    return normal_map.albedo_rgb is not None and normal_map.notes.get("colour") == SRGB


def srgb_profile() -> bytes:
    """ICC profile of sRGB (LittleCMS), of a fixed date, so that equal results make equal files."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile[:24] + struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + profile[36:]


def albedo_png(path: Path, normal_map: NormalMap) -> None:
    """Writes the albedo in 16 bits with sRGB's curve, RGB or grey, black outside the mask. If colours are calibrated, 1
    is white and the profile is embedded; else the brightest half per cent is white, the description has its value."""
    calibrated = is_srgb(normal_map)
    albedo = normal_map.albedo if normal_map.albedo_rgb is None else normal_map.albedo_rgb
    white = 1.0
    if not calibrated and np.any(normal_map.mask):
        white = max(float(np.quantile(albedo[normal_map.mask], WHITE_QUANTILE)), 1e-9)
    coded = np.zeros(albedo.shape, np.uint16)
    for rows in row_blocks(len(albedo)):
        values: FloatArray = colour.encoded_srgb(albedo[rows].astype(np.float64) / white)
        coded[rows] = np.round(65535 * values)
    coded[~normal_map.mask] = 0
    space = "sRGB, 1 is white" if calibrated else f"{normal_map.notes.get('colour', 'grey')}, {white:.4g} is white"
    profile = srgb_profile() if calibrated else None
    png(path, coded, f"albedo, {space}, coded with sRGB's curve", profile)


def mask_png(path: Path, mask: BoolArray) -> None:
    """Writes a mask (H, W) as an 8-bit PNG, white inside."""
    png(path, mask.astype(np.uint8) * 255)


def png(path: Path, pixels: np.ndarray, description: str = "", profile: bytes | None = None) -> None:
    """Writes an 8- or 16-bit PNG, (H, W) or (H, W, 3) RGB, with description (Latin-1) and ICC profile, if given."""
    _write(path, cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.ndim == 3 else pixels, description, profile)


def _write(path: Path, pixels: np.ndarray, description: str, profile: bytes | None = None) -> None:
    """Writes a PNG of pixels in OpenCV's order."""
    encoded, content = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not encoded:
        raise OSError(f"{path} could not be encoded")
    behind_header = 8 + 25  # signature, and IHDR with its 13 bytes
    with path.open("wb") as file:
        file.write(content.data[:behind_header])
        if profile is not None:
            file.write(_chunk(b"iCCP", b"ICC\0\0" + zlib.compress(profile)))
        if description:
            file.write(_chunk(b"tEXt", b"Description\0" + description.encode("latin-1")))
        file.write(content.data[behind_header:])


def _chunk(kind: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file with its length and check sum."""
    return len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4, "big")


def float_tiff(path: Path, values: Float32Array, description: str) -> None:
    """Writes a float32 TIFF, (H, W) or (H, W, 3), uncompressed."""
    kind = "rgb" if values.ndim == 3 else "minisblack"
    tifffile.imwrite(path, values, photometric=kind, description=description.encode(), metadata=None)
