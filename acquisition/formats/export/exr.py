"""All maps as the named channels of one EXR file, with units and convention in its header.

Normals and albedo are halves: 0.002° and a third of the time and size; depth and σ keep their floats.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.export import albedo_files, map_files
from acquisition.models.result import NormalMap


def write(path: Path, normal_map: NormalMap) -> None:
    """Writes channels N.X, N.Y, N.Z, albedo (half), Z (depth), sigma_deg (float); where known, R, G, B, indirect."""
    channels = {
        f"N.{axis}": np.ascontiguousarray(normal_map.normals[..., index], np.float16)
        for index, axis in enumerate("XYZ")
    }
    channels |= {"albedo": normal_map.albedo.astype(np.float16)} | albedo_files.rgb_channels(normal_map)
    floats = {"Z": normal_map.depth, "sigma_deg": normal_map.sigma_deg, "indirect": normal_map.indirect}
    channels |= {name: np.nan_to_num(values, nan=0.0) for name, values in floats.items() if values is not None}
    albedo_files.write_channels(
        path,
        normal_map,
        channels,
        convention=f"N.X N.Y N.Z: unit normal, {map_files.FRAME}",
        units=f"Z: depth along the camera's axis, {map_files.depth_unit(normal_map)}; sigma_deg: degrees; albedo: "
        "share of the light, R G B of each channel; zero where unsolved",
    )
