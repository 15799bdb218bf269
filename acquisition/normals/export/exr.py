"""All maps as the named channels of one EXR file, with units and convention in its header.

Normals and albedo are halves: 0.002° and a third of the time and size; depth and σ keep their floats.
"""

from pathlib import Path

import numpy as np

from acquisition.normals.export import images
from acquisition.types import NormalMap

CHANNELS = {
    "convention": f"N.X N.Y N.Z: unit normal, {images.FRAME}",
    "units": "Z: depth along the camera's axis, m; sigma_deg: degrees; albedo: share of the light; zero where unsolved",
}


def write(path: Path, normal_map: NormalMap) -> None:
    """Writes channels N.X, N.Y, N.Z, albedo (half), Z (depth), sigma_deg and, where predicted, indirect (float)."""
    import OpenEXR  # noqa: PLC0415 - few results are exported

    channels = {
        f"N.{axis}": np.ascontiguousarray(normal_map.normals[..., index], np.float16)
        for index, axis in enumerate("XYZ")
    }
    channels["albedo"] = normal_map.albedo.astype(np.float16)
    floats = {"Z": normal_map.depth, "sigma_deg": normal_map.sigma_deg, "indirect": normal_map.indirect}
    channels |= {name: np.nan_to_num(values, nan=0.0) for name, values in floats.items() if values is not None}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "comments": "; ".join(CHANNELS.values()),
    }
    OpenEXR.File(header | CHANNELS, channels).write(str(path))
