"""A result's folder: pictures and maps for people and other programs, and what reads back exactly.

Pictures cannot hold all that a solver returns (flags per light, Fisher information, factors, noise): `normal_map.npz`
has the rest, so that another process reads back exactly what was written. The folder appears as a whole or not at all.
"""

import json
import os
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import tifffile
from pydantic import TypeAdapter

from acquisition.formats.atomic_write import atomic_folder
from acquisition.formats.export import map_files
from acquisition.models.base import BoolArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import FisherInformation, GoodnessOfFit, ModelFinding, NormalMap
from acquisition.normals import memory_mapped

ARCHIVE = "normal_map.npz"
OPTIONAL = ("albedo_rgb", "indirect")
UNITS = {
    "normals": "unit normals x, y, z",
    "depth": "depth along the camera's axis",
    "sigma_deg": "1 sigma of the normal, degrees, both tangential directions together",
    "albedo": "albedo",
    "albedo_rgb": "albedo of each channel, R G B",
    "residual": "rms of residuals over their expected spread",
    "indirect": "share of the light that other surfaces threw",
}


def write(normal_map: NormalMap, folder: Path) -> list[str]:
    """Writes the files of a result into a new folder and returns their names; an existing one is replaced as a whole.

    normals.png (16-bit RGB, OpenGL green), mask.png, lights_used.png (count), normals/depth/sigma_deg/albedo/residual
    and, where they are known, albedo_rgb and indirect .tiff (float32; m, degrees), doubtful.png, mask_proposed.png,
    normal_map.npz.
    """
    with atomic_folder(folder) as partial:
        write_into(normal_map, partial)
        return sorted(path.name for path in partial.iterdir())


def write_into(normal_map: NormalMap, folder: Path) -> None:
    """The same files into an existing folder, beside whatever else belongs to the result."""
    write_maps(normal_map, folder)
    with open(folder / ARCHIVE, "wb") as file:
        np.savez(file, allow_pickle=False, **_arrays(normal_map))
        file.flush()
        os.fsync(file.fileno())


def write_maps(normal_map: NormalMap, folder: Path) -> None:
    """The pictures and float maps alone, into an existing folder."""
    map_files.normals_png(folder / "normals.png", normal_map.normals, normal_map.mask)
    map_files.png(folder / "mask.png", normal_map.mask.astype(np.uint8) * 255)
    if normal_map.notes.get("mask") == "proposed":
        map_files.png(folder / "mask_proposed.png", normal_map.silhouette.astype(np.uint8) * 255)
    map_files.png(folder / "lights_used.png", lights_used(normal_map))
    if normal_map.doubtful is not None:
        map_files.png(folder / "doubtful.png", normal_map.doubtful.astype(np.uint8) * 255)
    for name, unit in UNITS.items():
        values = getattr(normal_map, name)
        if values is not None:
            more = f", {map_files.depth_unit(normal_map)}" if name == "depth" else ""
            map_files.float_tiff(folder / f"{name}.tiff", values, f"{unit}{more}; {map_files.FRAME}")


_FIT: TypeAdapter[GoodnessOfFit | None] = TypeAdapter(GoodnessOfFit | None)
_FINDINGS: TypeAdapter[tuple[ModelFinding, ...]] = TypeAdapter(tuple[ModelFinding, ...])


def lights_used(normal_map: NormalMap) -> np.ndarray:
    """How many lights each pixel's normal rests on (H, W), uint8."""
    count = np.zeros(normal_map.mask.shape, np.uint8)
    for flags in memory_mapped.iterate(normal_map.flags):
        count += flags & 1
    return count


def read(folder: Path) -> NormalMap:
    """Reads back what `write` was given, exactly. Raises RigError store.corrupt naming the file."""
    path = folder / ARCHIVE
    try:
        with np.load(path, allow_pickle=False) as stored:
            maps = {
                name: tifffile.imread(folder / f"{name}.tiff")
                for name in UNITS
                if name not in OPTIONAL or (folder / f"{name}.tiff").exists()
            }
            shape = maps["depth"].shape
            return NormalMap(
                **maps,
                mask=_unpacked(stored["mask"], shape),
                silhouette=_unpacked(stored["silhouette"], shape),
                flags=stored["flags"],
                intensity_factors=stored["intensity_factors"],
                information=FisherInformation(
                    rows=stored["information_rows"],
                    columns=stored["information_columns"],
                    matrices=stored["information_matrices"],
                ),
                doubtful=_unpacked(stored["doubtful"], shape) if "doubtful" in stored else None,
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
    doubtful = {} if normal_map.doubtful is None else {"doubtful": np.packbits(normal_map.doubtful)}
    return doubtful | {
        "mask": np.packbits(normal_map.mask),
        "silhouette": np.packbits(normal_map.silhouette),
        "flags": normal_map.flags,
        "intensity_factors": normal_map.intensity_factors,
        "information_rows": normal_map.information.rows,
        "information_columns": normal_map.information.columns,
        "information_matrices": normal_map.information.matrices,
        "noise": np.array(json.dumps(normal_map.noise)),
        "notes": np.array(json.dumps(normal_map.notes)),
        "fit": np.array(_FIT.dump_json(normal_map.fit).decode()),
        "findings": np.array(_FINDINGS.dump_json(normal_map.findings).decode()),
    }


def _unpacked(bits: np.ndarray, shape: tuple[int, ...]) -> BoolArray:
    return np.unpackbits(bits, count=int(np.prod(shape))).reshape(shape).astype(np.bool_)
