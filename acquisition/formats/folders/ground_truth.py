"""Ground-truth normals of a folder's object: from a file of normals, or from the outline of a sphere."""

import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tifffile

from acquisition import geometry
from acquisition.formats.folders.refusal import refusal
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.normals.images.image_set import Camera

FILES = ("Normal_gt.mat", "normals_gt.npy", "normals_gt.tiff", "normals_gt.tif", "normals_gt.exr")
VARIABLE = "Normal_gt"
MIN_RELATIVE_LENGTH = 0.02
"""Minimum length of a vector that counts as known, as a share of the median length of the non-zero vectors."""

EXR_CHANNELS = (("N.X", "N.Y", "N.Z"), ("normal.X", "normal.Y", "normal.Z"), ("X", "Y", "Z"), ("R", "G", "B"))


class Sphere(NamedTuple):
    """A sphere's outline in the image: column and row of its centre (pixel centres at whole numbers) and radius, px."""

    column: float
    row: float
    radius: float


def read(folder: Path, height: int, width: int) -> Float32Array | None:
    """Reads true normals (H, W, 3), view frame, of unit length or zero where unknown; None: the folder has none.

    Raises RigError folder.invalid naming the file when it is damaged or of another size.
    """
    for name in FILES:
        path = folder / name
        if path.is_file():
            return _normals(path, _load(path), height, width)
    return None


def sphere_normals(sphere: Sphere, height: int, width: int, camera: Camera | None) -> tuple[Float32Array, BoolArray]:
    """Normals (H, W, 3), view frame, of a sphere seen by this camera (None: orthographic), and where it is (H, W).

    In perspective, the rays of the outline form a cone about the ray of the centre, with the half angle of the radius.
    Off the axis the sphere's image is an ellipse, and its normals are not those of a hemisphere.
    """
    row, column = np.mgrid[:height, :width].astype(np.float64)
    if camera is None:
        x, y = (column - sphere.column) / sphere.radius, -(row - sphere.row) / sphere.radius
        z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
        inside = x * x + y * y < 1
        return np.where(inside[..., None], np.stack([x, y, z], axis=-1), 0).astype(np.float32), inside
    around = [(0, 0), (sphere.radius, 0), (-sphere.radius, 0), (0, sphere.radius), (0, -sphere.radius)]
    edge = _rays(camera, np.array([[sphere.column + dx, sphere.row + dy] for dx, dy in around]))
    axis = edge[0]
    radius = float(np.sin(np.mean(np.arccos(np.clip(edge[1:] @ axis, -1, 1)))))
    ray = _rays(camera, np.stack([column.ravel(), row.ravel()], axis=-1)).reshape(height, width, 3)
    along = ray @ axis
    inside = along**2 - 1 + radius**2 > 0
    distance = along - np.sqrt(np.maximum(along**2 - 1 + radius**2, 0))
    normal = (ray * distance[..., None] - axis) / radius * np.array([1.0, -1.0, -1.0])  # OpenCV's frame to the view's
    return np.where(inside[..., None], normal, 0).astype(np.float32), inside


def _rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Unit rays (N, 3), OpenCV's frame, through pixels (N, 2)."""
    flat = geometry.undistorted(pixels, camera.matrix, camera.distortion)
    ray = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    return ray / np.linalg.norm(ray, axis=1, keepdims=True)


def _load(path: Path) -> np.ndarray:
    try:
        match path.suffix:
            case ".mat":
                return _mat(path)
            case ".npy":
                return np.load(path, allow_pickle=False)
            case ".exr":
                return _exr(path)
            case _:
                return np.asarray(tifffile.imread(path))
    except KeyError as error:
        raise refusal(path, f"has no variable {VARIABLE}: give the normals this name") from error
    except NotImplementedError as error:
        raise refusal(path, "is in MATLAB's format 7.3: save it with -v7") from error
    except (OSError, ValueError, TypeError, EOFError, IndexError, tifffile.TiffFileError) as error:
        raise refusal(path, f"cannot be read: {error}; copy it again, or remove it") from error


def _mat(path: Path) -> np.ndarray:
    from scipy.io import loadmat  # noqa: PLC0415 - a tenth of a second that few folders need
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    try:
        return np.asarray(loadmat(path, variable_names=[VARIABLE])[VARIABLE])
    except (MatReadError, zlib.error) as error:
        raise ValueError(str(error)) from error


def _exr(path: Path) -> np.ndarray:
    import OpenEXR  # noqa: PLC0415 - few folders need it

    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except RuntimeError as error:
        raise refusal(path, f"cannot be read: {error}; copy it again, or remove it") from error
    for names in EXR_CHANNELS:
        if all(name in channels for name in names):
            return np.stack([channels[name].pixels for name in names], axis=-1)
    raise refusal(
        path, f"has channels {', '.join(sorted(channels))}: name those of the normals N.X, N.Y, N.Z or R, G, B"
    )


def _normals(path: Path, values: np.ndarray, height: int, width: int) -> Float32Array:
    if values.shape != (height, width, 3):
        raise refusal(path, f"has shape {values.shape}, not {(height, width, 3)}: use the normals of these images")
    if values.dtype.kind not in "iuf":
        raise refusal(path, f"holds values of the type {values.dtype}: store the normals as real numbers")
    normals = np.nan_to_num(values.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if not np.any(length > 0):
        raise refusal(path, "holds only zero vectors: store the normals with x right, y up, z to the camera")
    # Vectors may have any length; those far shorter than the others mark pixels without known normals.
    least = MIN_RELATIVE_LENGTH * float(np.median(length[length > 0]))
    return np.where(length > least, normals / np.maximum(length, least), 0).astype(np.float32)
