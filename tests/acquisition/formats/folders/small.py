"""Small capture folders of a diffuse sphere in the formats of other programs."""

import json
from pathlib import Path

import cv2
import numpy as np
import tifffile

SIZE, RADIUS, ALBEDO = 40, 16.0, 0.6
DIRECTIONS = np.array(
    [[0.0, 0.0, 1.0], [0.5, 0.0, 0.87], [-0.5, 0.1, 0.86], [0.1, 0.5, 0.86], [0.0, -0.6, 0.8], [0.4, 0.4, 0.82]]
)


def sphere() -> tuple[np.ndarray, np.ndarray]:
    """Normals (H, W, 3), x right, y up, z to the camera, and the mask (H, W)."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x, y = (column - SIZE / 2) / RADIUS, -(row - SIZE / 2) / RADIUS
    mask = x**2 + y**2 < 0.98
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    return np.where(mask[..., None], np.stack([x, y, z], -1), 0), mask


def renders(directions: np.ndarray = DIRECTIONS) -> np.ndarray:
    """Images (F, H, W) of the sphere under distant lights, as fractions of full scale."""
    normals, _ = sphere()
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return ALBEDO * np.clip(np.einsum("hwc,fc->fhw", normals, units), 0, None)


def sixteen(image: np.ndarray) -> np.ndarray:
    return np.round(image * 65535).astype(np.uint16)


def diligent(folder: Path, colour: bool = True) -> Path:
    """A DiLiGenT-style folder with RGB intensities that differ."""
    folder.mkdir(parents=True, exist_ok=True)
    power = 1 + 0.2 * np.sin(np.arange(3 * len(DIRECTIONS))).reshape(-1, 3)
    names = [f"{number:03d}.png" for number in range(1, len(DIRECTIONS) + 1)]
    for name, image, row in zip(names, renders(), power, strict=True):
        pixels = sixteen(image[..., None] * row if colour else image * row.mean())
        cv2.imwrite(str(folder / name), pixels[..., ::-1] if colour else pixels)
    (folder / "filenames.txt").write_text("\n".join(names) + "\n")
    np.savetxt(folder / "light_directions.txt", DIRECTIONS)
    np.savetxt(folder / "light_intensities.txt", power)
    cv2.imwrite(str(folder / "mask.png"), sphere()[1].astype(np.uint8) * 255)
    return folder


def lp(folder: Path, bits: int = 16) -> Path:
    """An `.lp` folder without a mask."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [str(len(DIRECTIONS))]
    for number, (image, direction) in enumerate(zip(renders(), DIRECTIONS, strict=True)):
        pixels = sixteen(image) if bits == 16 else np.round(image * 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"img {number}.png"), pixels)
        rows.append(f"img {number}.png {direction[0]} {direction[1]} {direction[2]}")
    (folder / "lights.lp").write_text("\n".join(rows))
    return folder


def near(folder: Path, positions_mm: np.ndarray | None = None) -> Path:
    """A near-light folder: a ball of 40 mm radius, 500 mm away, TIFF images."""
    folder.mkdir(parents=True, exist_ok=True)
    focal = RADIUS * 500 / 40
    positions = np.array([[0, 0, 100], [250, 0, 150], [-250, 50, 150], [0, 260, 120], [50, -240, 150], [180, 180, 200]])
    positions = positions.astype(float) if positions_mm is None else positions_mm
    column, row = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    ray = np.stack([(column - SIZE / 2) / focal, (row - SIZE / 2) / focal, np.ones((SIZE, SIZE))], -1)
    unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    middle = np.array([0, 0, 500.0])
    projection = unit @ middle
    discriminant = projection**2 - 500**2 + 40**2
    mask = discriminant > 0
    point = unit * (projection - np.sqrt(np.clip(discriminant, 0, None)))[..., None]
    normals = np.where(mask[..., None], (point - middle) / 40, 0)
    lights = []
    for number, position in enumerate(positions):
        to_lamp = position - point
        r = np.linalg.norm(to_lamp, axis=-1)
        intensity = 0.9 + 0.02 * number
        shading = np.clip(np.sum(normals * to_lamp, axis=-1) / r, 0, None) * (400 / r) ** 2
        tifffile.imwrite(folder / f"{number}.tiff", sixteen(ALBEDO * intensity * shading * mask))
        lights.append({"file": f"{number}.tiff", "position": position.tolist(), "intensity": intensity})
    camera = {"K": [[focal, 0, SIZE / 2], [0, focal, SIZE / 2], [0, 0, 1]], "distortion": [0, 0, 0, 0, 0]}
    content = {"unit": "mm", "reference_mm": 400, "camera": camera, "lights": lights, "depth_mm": 480}
    (folder / "lights.json").write_text(json.dumps(content))
    cv2.imwrite(str(folder / "mask.png"), mask.astype(np.uint8) * 255)
    np.save(folder / "normals_gt.npy", normals * [1, -1, -1])
    return folder
