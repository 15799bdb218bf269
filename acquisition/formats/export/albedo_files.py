"""The albedo as pictures: linear in EXR with its primaries, coded as sRGB in PNG with its profile.

Of a monochrome camera, or a mosaic sensor without a colour calibration, no primaries are known, and none are claimed.
"""

from pathlib import Path

import numpy as np

from acquisition import colour
from acquisition.formats.export import icc_profile, map_files
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
    import OpenEXR  # noqa: PLC0415 - few results are exported

    rgb, header = normal_map.albedo_rgb, {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if is_srgb(normal_map):
        header |= {"chromaticities": colour.SRGB_CHROMATICITIES}
    header |= {"comments": f"albedo, {normal_map.notes.get('colour', 'grey')}; row 0 at the top"}
    channels = (
        {"Y": normal_map.albedo.astype(np.float16)}
        if rgb is None
        else {name: np.ascontiguousarray(rgb[..., index], np.float16) for index, name in enumerate("RGB")}
    )
    OpenEXR.File(header, channels).write(str(path))


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
    profile = icc_profile.srgb() if calibrated else None
    map_files.png(path, coded, f"albedo, {space}, coded with sRGB's curve", profile)
