"""Small completed sessions, each another capture: that of release 0.1 with other noise, object and id."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import tifffile

from acquisition.store.folder import write_manifest

ORIGINAL = Path(__file__).parents[2] / "data" / "release_0.1" / "sessions" / "20261121-190041-de2be6"
NOISE_DN = 3.0


def make(folder: Path, seed: int = 0, *, label: str = "vase", cell: str | None = None, results: bool = True) -> Path:
    """Writes the session `folder`.name; seeds differ in the noise of each frame."""
    shutil.copytree(ORIGINAL, folder, ignore=None if results else shutil.ignore_patterns("results"))
    noise = np.random.default_rng(seed)
    for path in sorted(folder.glob("passes/*/shots/*.tiff")):
        pixels = tifffile.imread(path)
        varied = np.clip(pixels + noise.normal(0, NOISE_DN, pixels.shape), 0, 4095).astype(np.uint16)
        tifffile.imwrite(path, varied, photometric="minisblack", metadata=None)
    _change(folder / "recipe.json", label=label)
    if cell is not None:
        _change(folder / "cell.json", name=cell)
    shots = json.loads((ORIGINAL / "manifest.json").read_text())["shots"]
    write_manifest(folder, {"session_id": folder.name, "software": {"lightpose": "0.1.0"}, "shots": shots})
    return folder


def enlarge(folder: Path, factor: int, seed: int = 0) -> Path:
    """Makes a session's images and camera `factor` times as large in each direction, with new noise of the sensor."""
    noise = np.random.default_rng(seed)
    for path in sorted(folder.glob("passes/**/*.tiff")):
        pixels = tifffile.imread(path).astype(np.float32)
        large = cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        large += NOISE_DN * noise.standard_normal(large.shape, np.float32)
        tifffile.imwrite(path, np.clip(large, 0, 4095).astype(np.uint16), photometric="minisblack", metadata=None)
    calibration = json.loads((folder / "calibration.json").read_text())
    (fx, skew, cx), (_, fy, cy), last = calibration["camera_matrix"]
    centre = [(one + 0.5) * factor - 0.5 for one in (cx, cy)]
    matrix = [[fx * factor, skew, centre[0]], [0.0, fy * factor, centre[1]], last]
    size = {"width": calibration["width"] * factor, "height": calibration["height"] * factor}
    _change(folder / "calibration.json", camera_matrix=matrix, **size)
    stated = json.loads((folder / "manifest.json").read_text())
    for shot in stated["shots"]:
        shot["frame"] |= size
    shutil.rmtree(folder / "results", ignore_errors=True)
    write_manifest(folder, {name: stated[name] for name in ("session_id", "software", "shots")})
    return folder


def _change(path: Path, **values: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | values))
