"""Image regions: projection of the keep-out cylinder, and the mask of the region of interest.

The runner passes them to several stages: capture checks a frame's exposure in the keep-out cylinder, normals look for
the object's silhouette there and start from the depth of its middle, and the plan serves the region of interest.
"""

import struct

import cv2
import numpy as np

from acquisition import geometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError

_CIRCLE_POINTS = 96
TILE_EDGE_PX, MIN_TILE_PIXELS = 2, 25
"""Width, px, of the grey tile's edge that does not count, and the least number of pixels that have to be left."""

_PNG_START = b"\x89PNG\r\n\x1a\n"


def keep_out(cell: CellConfig, calibration: Calibration) -> BoolArray:
    """Returns the mask (H, W) of pixels whose rays meet the keep-out cylinder, by projection with lens distortion."""
    cylinder = cell.object.keep_out
    around = np.linspace(0, 2 * np.pi, _CIRCLE_POINTS, endpoint=False)
    circle = np.stack([cylinder.radius_m * np.cos(around), cylinder.radius_m * np.sin(around)], axis=-1)
    points = np.concatenate(
        [np.column_stack([circle, np.full(len(circle), height)]) for height in (0.0, cylinder.height_m)]
    )
    base_points = geometry.transform(cylinder.base_from_object.matrix, points)
    camera_points = geometry.transform(geometry.inverse(np.array(calibration.base_from_camera)), base_points)
    pixels, _ = cv2.projectPoints(
        camera_points,
        np.zeros(3),
        np.zeros(3),
        np.array(calibration.camera_matrix),
        np.array(calibration.distortion),
    )
    # The outline of a convex body is convex except for the distortion; coordinates are eighths of a pixel (`shift`).
    outline = cv2.convexHull(np.round(pixels[:, 0] * 8).astype(np.int32))
    image = np.zeros((calibration.height, calibration.width), np.uint8)
    cv2.fillConvexPoly(image, outline, 1, shift=3)
    return image.astype(np.bool_)


def decode_mask(content: bytes, calibration: Calibration) -> BoolArray:
    """Decodes a mask (H, W) from a PNG of the camera's size; pixels that are not black belong to it.

    Raises RigError request.invalid when it is no PNG, of another size, or all black.
    """
    wanted = (calibration.width, calibration.height)
    # The size in the header is checked before anything is unpacked: a small file can hold a huge image.
    size = struct.unpack(">II", content[16:24]) if content.startswith(_PNG_START) and len(content) > 24 else None
    if size is not None and size != wanted:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"the mask is {size[0]} × {size[1]} pixels and the camera's images are {wanted[0]} × {wanted[1]}: draw it "
            "on an image of this camera",
        )
    image = None if size is None else cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise RigError(ErrorCode.REQUEST_INVALID, "the mask is not a PNG image, or it is damaged: send a PNG file")
    mask = np.any(np.asarray(image) > 0, axis=-1)
    if not np.any(mask):
        raise RigError(ErrorCode.REQUEST_INVALID, "the mask is all black: paint the region of interest in white")
    return mask


def encode_mask(mask: BoolArray) -> bytes:
    """Encodes a mask (H, W) as a black-and-white PNG."""
    return cv2.imencode(".png", mask.astype(np.uint8) * 255)[1].tobytes()


def middle_depth_m(cell: CellConfig, calibration: Calibration) -> float:
    """Returns the depth (m, along the camera's z) of the keep-out cylinder's centre: the solver's initial depth."""
    cylinder = cell.object.keep_out
    center = geometry.transform(cylinder.base_from_object.matrix, [0.0, 0.0, cylinder.height_m / 2])
    return float(geometry.transform(geometry.inverse(np.array(calibration.base_from_camera)), center)[2])


def grey_tile(cell: CellConfig, calibration: Calibration) -> BoolArray | None:
    """Returns the mask (H, W) of the grey tile without its edge, which the lens blurs; None if the cell has no tile.

    Raises RigError config.invalid if fewer than MIN_TILE_PIXELS of its pixels are in the image.
    """
    if cell.grey_tile is None:
        return None
    image = np.zeros((calibration.height, calibration.width), np.uint8)
    cv2.fillPoly(image, [np.round(np.array(cell.grey_tile.outline_px) * 8).astype(np.int32)], (1,), shift=3)
    image = cv2.erode(image, np.ones((2 * TILE_EDGE_PX + 1,) * 2, np.uint8), borderValue=0)
    if np.count_nonzero(image) < MIN_TILE_PIXELS:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"grey_tile.outline_px leaves {np.count_nonzero(image)} usable pixels, but {MIN_TILE_PIXELS} are needed: "
            f"the image has columns 0 to {calibration.width - 1} and rows 0 to {calibration.height - 1}",
        )
    return image.astype(np.bool_)


def table_depth_m(cell: CellConfig, calibration: Calibration, above_m: float = 0.0) -> Float32Array:
    """Returns the depth (H, W), m, along the camera's z of the plane `above_m` over the table, by ray–plane
    intersection; infinite where a ray misses it."""
    camera_from_base = geometry.inverse(np.array(calibration.base_from_camera))
    normal = geometry.rotate(camera_from_base, np.array(cell.table.normal) / np.linalg.norm(cell.table.normal))
    point = geometry.transform(camera_from_base, cell.table.point_m) + above_m * normal
    rows, columns = np.mgrid[0 : calibration.height, 0 : calibration.width]
    pixels = np.stack([columns, rows], axis=-1)
    ray = geometry.undistorted(pixels, calibration.camera_matrix, calibration.distortion).reshape(pixels.shape)
    falling = ray @ normal[:2] + normal[2]
    depth = np.full(falling.shape, np.inf)
    np.divide(normal @ point, falling, out=depth, where=falling * (normal @ point) > 0)
    return depth.astype(np.float32)
