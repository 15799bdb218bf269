"""Maps as named channels of EXR files, with units and convention in their headers.

Normals and albedo are half floats: normals err by 0.006° in the mean and 0.024° at most (four million random ones), and
take a third of the time and size. Depth and σ remain floats, and so does an albedo in a unit in which half floats
cannot hold it.
The albedo is linear and states its primaries. For a monochrome camera, or a mosaic sensor without a colour calibration,
primaries are not known and not stated.
"""

import errno
import os
from pathlib import Path

import numpy as np

from acquisition import colour
from acquisition.formats.export import map_files
from acquisition.models.result import NormalMap

LEAST_HALF = 1e-3
"""Albedo whose tenth half floats still hold to three digits."""


def write_maps(path: Path, normal_map: NormalMap) -> None:
    """Writes channels N.X, N.Y, N.Z, albedo (half), Z (depth), sigma_deg (float); where known, R, G, B, indirect."""
    channels = {
        f"N.{axis}": np.ascontiguousarray(normal_map.normals[..., index], np.float16)
        for index, axis in enumerate("XYZ")
    }
    channels |= {"albedo": _half(normal_map.albedo)} | _colours(normal_map)
    floats = {"Z": normal_map.depth, "sigma_deg": normal_map.sigma_deg, "indirect": normal_map.indirect}
    channels |= {name: np.nan_to_num(values, nan=0.0) for name, values in floats.items() if values is not None}
    _write(
        path,
        normal_map,
        channels,
        convention=f"N.X N.Y N.Z: unit normal, {map_files.FRAME}",
        units=f"Z: depth along the camera's axis, {map_files.depth_unit(normal_map)}; sigma_deg: degrees; albedo: "
        "share of the light, R G B of each channel; zero where unsolved",
    )


def write_albedo(path: Path, normal_map: NormalMap) -> None:
    """Writes channels R, G, B (half, linear), or Y of a grey albedo; zero where there is none, not clipped to 0–1."""
    channels = _colours(normal_map) or {"Y": _half(normal_map.albedo)}
    text = f"albedo, {normal_map.notes.get('colour', 'grey')}; row 0 at the top"
    _write(path, normal_map, channels, comments=text)


def _colours(normal_map: NormalMap) -> dict[str, np.ndarray]:
    """The channels R, G, B (half) of a coloured albedo; a grey one has none of them."""
    colours = normal_map.albedo_rgb
    if colours is None:
        return {}
    halves = _half(colours)
    return {name: np.ascontiguousarray(halves[..., index]) for index, name in enumerate("RGB")}


def _half(albedo: np.ndarray) -> np.ndarray:
    """Converts an albedo to half floats, if they hold its greatest value to their full precision."""
    greatest = float(np.max(albedo, initial=0.0))
    fits = greatest == 0 or LEAST_HALF < greatest <= float(np.finfo(np.float16).max)
    return albedo.astype(np.float16 if fits else np.float32)


def _write(path: Path, normal_map: NormalMap, channels: dict[str, np.ndarray], **texts: str) -> None:
    """Writes an EXR file of channels (H, W), with texts in its header, and sRGB's primaries if the albedo has them."""
    import OpenEXR  # noqa: PLC0415 - few results are exported

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | texts
    if map_files.is_srgb(normal_map):
        header |= {"chromaticities": colour.SRGB_CHROMATICITIES}
    try:
        OpenEXR.File(header, channels).write(str(path))
    except RuntimeError as error:  # OpenEXR's own, also of a full disk
        full = os.strerror(errno.ENOSPC) in str(error)
        raise OSError(errno.ENOSPC if full else errno.EIO, str(error)) from error
    if path.stat().st_size == 0:  # of a file of one block it reports nothing
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
