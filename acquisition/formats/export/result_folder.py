"""A result's folder: pictures and maps for people and other programs, and an archive for exact reading.

Pictures cannot hold all that a solver returns (flags per light, Fisher information, factors, noise). `normal_map.npz`
has the rest, so that another process reads back exactly what was written. The folder appears as a whole or not at all.
"""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import tifffile
from pydantic import TypeAdapter

from acquisition.formats.atomic_write import atomic_folder
from acquisition.formats.export import map_files
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import FisherInformation, GoodnessOfFit, ModelFinding, NormalMap
from acquisition.normals.images import memory_mapped

ARCHIVE = "normal_map.npz"
MASKS, OPTIONAL = ("doubtful", "mask", "silhouette"), ("albedo_rgb", "indirect")
INFORMATION = tuple(field.name for field in fields(FisherInformation))
UNITS = {
    "normals": "unit normals x, y, z",
    "depth": "depth along the camera's axis",
    "sigma_deg": "1 sigma of the normal, degrees, both tangential directions together",
    "albedo": "albedo",
    "albedo_rgb": "albedo of each channel, R G B",
    "residual": "rms of residuals over their expected spread",
    "indirect": "share of the light that came from other surfaces",
}


def write(normal_map: NormalMap, folder: Path) -> list[str]:
    """Writes the files of a result into a new folder and returns their names; an existing one is replaced as a whole.

    normals.png (16-bit RGB, OpenGL green), mask.png, lights_used.png (count), normals/depth/sigma_deg/albedo/residual
    and, where they are known, albedo_rgb and indirect .tiff (float32; m, degrees), doubtful.png, normal_map.npz, and
    mask_proposed.png where none was given.
    """
    with atomic_folder(folder) as partial:
        write_into(normal_map, partial)
        return sorted(path.name for path in partial.iterdir())


def write_into(normal_map: NormalMap, folder: Path) -> None:
    """Writes the same files into an existing folder, beside other files of the result."""
    write_maps(normal_map, folder)
    with open(folder / ARCHIVE, "wb") as file:
        np.savez(file, allow_pickle=False, **_arrays(normal_map))


def write_maps(normal_map: NormalMap, folder: Path) -> None:
    """Writes only the pictures and float maps, into an existing folder."""
    map_files.normals_png(folder / "normals.png", normal_map.normals, normal_map.mask)
    map_files.mask_png(folder / "mask.png", normal_map.mask)
    map_files.mask_png(folder / "doubtful.png", normal_map.doubtful)
    if normal_map.notes.get("mask") == "proposed":
        map_files.mask_png(folder / "mask_proposed.png", normal_map.silhouette)
    map_files.png(folder / "lights_used.png", lights_used(normal_map))
    units = {"depth": map_files.depth_unit(normal_map), "albedo_rgb": normal_map.notes.get("colour")}
    for name, unit in UNITS.items():
        values = getattr(normal_map, name)
        if values is not None:
            more = f", {units[name]}" if units.get(name) else ""
            map_files.float_tiff(folder / f"{name}.tiff", values, f"{unit}{more}; {map_files.FRAME}")


_FIT: TypeAdapter[GoodnessOfFit | None] = TypeAdapter(GoodnessOfFit | None)
_FINDINGS: TypeAdapter[tuple[ModelFinding, ...]] = TypeAdapter(tuple[ModelFinding, ...])


def lights_used(normal_map: NormalMap) -> np.ndarray:
    """Number of lights that each pixel's normal is solved from (H, W), uint8; uint16 of more than 255 images."""
    count = np.zeros(normal_map.mask.shape, np.uint8 if len(normal_map.flags) <= np.iinfo(np.uint8).max else np.uint16)
    for flags in memory_mapped.iterate(normal_map.flags):
        count += flags & 1
    return count


def read(folder: Path) -> NormalMap:
    """Reads back what `write` was given, exactly. Raises RigError store.corrupt naming the file."""
    path = folder / ARCHIVE
    try:
        with np.load(path, allow_pickle=False) as stored:
            maps: dict[str, Any] = {
                name: tifffile.imread(folder / f"{name}.tiff")
                for name in UNITS
                if name not in OPTIONAL or (folder / f"{name}.tiff").exists()
            }
            shape = maps["depth"].shape
            for name in MASKS:
                maps[name] = np.unpackbits(stored[name], count=np.prod(shape)).reshape(shape).astype(np.bool_)
            return NormalMap(
                **maps,
                flags=stored["flags"],
                intensity_factors=stored["intensity_factors"],
                information=FisherInformation(*(stored[f"information_{name}"] for name in INFORMATION)),
                noise=json.loads(str(stored["noise"])),
                notes=json.loads(str(stored["notes"])),
                fit=_FIT.validate_json(str(stored["fit"])) if "fit" in stored else None,
                findings=_FINDINGS.validate_json(str(stored["findings"])) if "findings" in stored else (),
            )
    except (OSError, ValueError, KeyError, tifffile.TiffFileError, EOFError, BadZipFile) as error:
        raise RigError(
            ErrorCode.STORE_CORRUPT, f"{path}: is not a normal map: {error}; solve the session again", file=str(path)
        ) from error


def _arrays(normal_map: NormalMap) -> dict[str, np.ndarray]:
    return {
        **{name: np.packbits(getattr(normal_map, name)) for name in MASKS},
        "flags": normal_map.flags,
        "intensity_factors": normal_map.intensity_factors,
        **{f"information_{name}": getattr(normal_map.information, name) for name in INFORMATION},
        "noise": np.array(json.dumps(normal_map.noise)),
        "notes": np.array(json.dumps(normal_map.notes)),
        "fit": np.array(_FIT.dump_json(normal_map.fit).decode()),
        "findings": np.array(_FINDINGS.dump_json(normal_map.findings).decode()),
    }
