"""A normal map as files that other programs read, and as one file that reads back exactly.

Pictures are for people and for normal-integration tools: normals as (n + 1)/2 in 16 bits (8 bits would cost 0.17°),
OpenGL green (+Y up). `normal_map.npz` holds what pictures cannot (flags per light, Fisher information, factors, noise),
so that another process reads back exactly what the solver returned. The folder appears as a whole or not at all.
"""

import json
import os
import shutil
import tempfile
from pathlib import Path
from zipfile import BadZipFile

import cv2
import numpy as np
import tifffile

from acquisition.errors import ErrorCode, RigError
from acquisition.types import Information, NormalMap

ARCHIVE = "normal_map.npz"
CONVENTION = "view frame: x right, y up, z to the camera; OpenGL green (+Y); row 0 at the top"
FLOAT_MAPS = ("normals", "depth", "sigma_deg", "albedo", "residual")


def write(normal_map: NormalMap, folder: Path) -> list[str]:
    """Writes all files into a new folder and returns their names; an existing folder is replaced as a whole.

    normals.png (16-bit RGB), mask.png, lights_used.png (count), normals/depth/sigma_deg/albedo/residual.tiff (float32;
    m, degrees) and normal_map.npz.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        colours = np.where(normal_map.mask[..., None], np.round((normal_map.normals + 1) / 2 * 65535), 0)
        _png(partial / "normals.png", np.clip(colours, 0, 65535).astype(np.uint16)[..., ::-1])  # OpenCV writes BGR
        _png(partial / "mask.png", normal_map.mask.astype(np.uint8) * 255)
        _png(partial / "lights_used.png", np.count_nonzero(normal_map.flags & 1, axis=0).astype(np.uint8))
        for name in FLOAT_MAPS:
            tifffile.imwrite(
                partial / f"{name}.tiff",
                getattr(normal_map, name),
                photometric="rgb" if name == "normals" else "minisblack",
                description=CONVENTION.encode(),
            )
        with open(partial / ARCHIVE, "wb") as file:
            np.savez(file, allow_pickle=False, **_arrays(normal_map))
            file.flush()
            os.fsync(file.fileno())
        names = sorted(path.name for path in partial.iterdir())
        partial.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        partial.rename(folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return names


def read(folder: Path) -> NormalMap:
    """Reads back what `write` was given, exactly. Raises RigError store.corrupt naming the file."""
    path = folder / ARCHIVE
    try:
        with np.load(path, allow_pickle=False) as stored:
            maps = {name: tifffile.imread(folder / f"{name}.tiff") for name in FLOAT_MAPS}
            shape = maps["depth"].shape
            count = int(np.prod(shape))
            flags = stored["flags"]
            return NormalMap(
                normals=maps["normals"],
                albedo=maps["albedo"],
                depth=maps["depth"],
                sigma_deg=maps["sigma_deg"],
                residual=maps["residual"],
                mask=np.unpackbits(stored["mask"], count=count).reshape(shape).astype(np.bool_),
                silhouette=np.unpackbits(stored["silhouette"], count=count).reshape(shape).astype(np.bool_),
                flags=flags,
                intensity_factors=stored["intensity_factors"],
                information=Information(
                    rows=stored["information_rows"],
                    columns=stored["information_columns"],
                    matrices=stored["information_matrices"],
                ),
                noise=json.loads(str(stored["noise"])),
                notes=json.loads(str(stored["notes"])),
            )
    except (OSError, ValueError, KeyError, tifffile.TiffFileError, EOFError, BadZipFile) as error:
        raise RigError(
            ErrorCode.STORE_CORRUPT, f"{path}: is not a normal map: {error}; solve the session again", file=str(path)
        ) from error


def _arrays(normal_map: NormalMap) -> dict[str, np.ndarray]:
    return {
        "mask": np.packbits(normal_map.mask),
        "silhouette": np.packbits(normal_map.silhouette),
        "flags": normal_map.flags,
        "intensity_factors": normal_map.intensity_factors,
        "information_rows": normal_map.information.rows,
        "information_columns": normal_map.information.columns,
        "information_matrices": normal_map.information.matrices,
        "noise": np.array(json.dumps(normal_map.noise)),
        "notes": np.array(json.dumps(normal_map.notes)),
    }


def _png(path: Path, pixels: np.ndarray) -> None:
    if not cv2.imwrite(str(path), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
        raise OSError(f"{path} could not be written")
