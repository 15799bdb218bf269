"""The albedo as pictures: linear in EXR with its primaries, coded as sRGB in PNG with its profile.

Of a monochrome camera, or a mosaic sensor without a colour calibration, no primaries are known, and none are claimed.
"""

import struct
from pathlib import Path

import numpy as np
from PIL import ImageCms

from acquisition import colour
from acquisition.formats.export import map_files
from acquisition.models.base import FloatArray
from acquisition.models.result import NormalMap
from acquisition.normals.colour_albedo import SRGB

WHITE_QUANTILE = 0.995
"""Quantile of a grey or uncalibrated albedo that is white in the PNG: its scale may be unknown."""


def is_srgb(normal_map: NormalMap) -> bool:
    """Whether the colours of the albedo are those of linear sRGB."""
    return normal_map.albedo_rgb is not None and normal_map.notes.get("colour") == SRGB


def write_exr(path: Path, normal_map: NormalMap) -> None:
    """Channels R, G, B (half, linear), or Y of a grey albedo; zero where there is none, beyond 0–1 as they are."""
    channels = rgb_channels(normal_map) or {"Y": normal_map.albedo.astype(np.float16)}
    text = f"albedo, {normal_map.notes.get('colour', 'grey')}; row 0 at the top"
    write_channels(path, normal_map, channels, comments=text)


def rgb_channels(normal_map: NormalMap) -> dict[str, np.ndarray]:
    """The channels R, G, B (half) of a coloured albedo, none of a grey one."""
    if normal_map.albedo_rgb is None:
        return {}
    return {
        name: np.ascontiguousarray(normal_map.albedo_rgb[..., index], np.float16) for index, name in enumerate("RGB")
    }


def write_channels(path: Path, normal_map: NormalMap, channels: dict[str, np.ndarray], **texts: str) -> None:
    """An EXR file of named channels (H, W), texts in its header, with sRGB's primaries where the albedo has them."""
    import OpenEXR  # noqa: PLC0415 - few results are exported

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | texts
    if is_srgb(normal_map):
        header |= {"chromaticities": colour.SRGB_CHROMATICITIES}
    OpenEXR.File(header, channels).write(str(path))


def srgb_profile() -> bytes:
    """ICC profile of sRGB (LittleCMS), of a fixed date, so that equal results make equal files."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile[:24] + struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + profile[36:]


def write_png(path: Path, normal_map: NormalMap) -> None:
    """16 bits with sRGB's curve, RGB or grey: 1 is white where colours are calibrated, and the profile is embedded;
    else the brightest half per cent is, and the description says by what it was divided. Black outside the mask."""
    calibrated = is_srgb(normal_map)
    albedo = normal_map.albedo if normal_map.albedo_rgb is None else normal_map.albedo_rgb
    white = 1.0
    if not calibrated and np.any(normal_map.mask):
        white = max(float(np.quantile(albedo[normal_map.mask], WHITE_QUANTILE)), 1e-9)
    coded = np.zeros(albedo.shape, np.uint16)
    for start in range(0, len(albedo), map_files.STRIP_ROWS):
        rows = slice(start, start + map_files.STRIP_ROWS)
        values: FloatArray = colour.encoded_srgb(albedo[rows].astype(np.float64) / white)
        coded[rows] = np.round(65535 * values)
    coded[~normal_map.mask] = 0
    space = "sRGB, 1 is white" if calibrated else f"{normal_map.notes.get('colour', 'grey')}, {white:.4g} is white"
    profile = srgb_profile() if calibrated else None
    map_files.png(path, coded, f"albedo, {space}, coded with sRGB's curve", profile)
