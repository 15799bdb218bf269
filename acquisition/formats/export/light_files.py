"""Export of lights: `.lp` (directions) and Relight's `.dome` (positions in mm about the object).

Programs match `.lp` rows by order and by name, so rows are in the images' order. Both formats describe lights as seen
from the object, so the direction of a near light is the one at `centre`. Intensities are those that the solver
estimated, if it did.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.result import NormalMap
from acquisition.normals.images.image_set import DistantLights, ImageSet

DISTANT_MM = 10_000.0


def with_estimated_intensities(images: ImageSet, normal_map: NormalMap) -> ImageSet:
    """Returns the images with estimated intensities of their lights: stated intensities times the solver's factors."""
    lights, factors = images.lights, normal_map.intensity_factors
    if isinstance(lights, DistantLights):
        each = np.asarray(normal_map.notes.get("intensity_factors", factors[:, None]), float)
        return replace(images, lights=replace(lights, intensities=lights.intensities * each))
    return replace(images, lights=replace(lights, intensity=lights.intensity * factors))


def directions(images: ImageSet, centre_m: FloatArray) -> FloatArray:
    """Unit directions (F, 3), view frame, from the point `centre_m` (3,) to the lights."""
    lights = images.lights
    offsets = lights.directions if isinstance(lights, DistantLights) else lights.positions_m - centre_m
    return offsets / np.linalg.norm(offsets, axis=1, keepdims=True)


def intensities(images: ImageSet, centre_m: FloatArray) -> FloatArray:
    """Signal (F, C) of a white surface that faces each light at `centre_m`, as a fraction of full scale."""
    lights = images.lights
    if isinstance(lights, DistantLights):
        return lights.intensities
    distance = np.linalg.norm(lights.positions_m - centre_m, axis=1)
    falloff = lights.intensity * (lights.reference_m / distance) ** 2
    return np.repeat(falloff[:, None], images.channels, axis=1)


def write_lp(path: Path, names: tuple[str, ...], units: FloatArray) -> None:
    """Writes the count and `name x y z` for each image; x right, y up, z to the camera."""
    rows = [f"{name} {x:.7f} {y:.7f} {z:.7f}" for name, (x, y, z) in zip(names, units, strict=True)]
    path.write_text("\n".join([str(len(rows)), *rows]) + "\n", encoding="utf-8")


def write_dome(path: Path, images: ImageSet, centre_m: FloatArray, width_m: float | None) -> None:
    """Writes a `.dome`: positions in mm with the origin at `centre_m`, x right, y up, z to the camera.

    `width_m` is the width of the scene that the image shows at the object; None: unknown. Distant lights are at 10 m.
    """
    units, lights = directions(images, centre_m), images.lights
    near = not isinstance(lights, DistantLights)
    positions = units * DISTANT_MM if isinstance(lights, DistantLights) else (lights.positions_m - centre_m) * 1000
    power = intensities(images, centre_m).mean(axis=1)
    content = {
        "label": "lightpose",
        "notes": "Positions in mm, x right, y up, z to the camera; origin: the object's centre.",
        "imageWidth": 0.0 if width_m is None else width_m * 1000,
        "domeDiameter": float(2 * np.mean(np.linalg.norm(positions, axis=1))),
        "verticalOffset": 0.0,
        "lightConfiguration": "lights3d" if near else "directional",
        "directions": [_vector(row) for row in units],
        "positionsSphere": [],
        "positions3d": [_vector(row) for row in positions] if near else [],
        "ledAdjust": [{"r": value, "g": value, "b": value} for value in (power.mean() / power).tolist()],
    }
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")


def _vector(row: FloatArray) -> dict[str, float]:
    x, y, z = (round(float(value), 6) for value in row)
    return {"x": x, "y": y, "z": z}
