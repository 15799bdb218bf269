"""Near-light folders: `lights.json` with lamp positions in the camera's frame, a calibrated camera, images beside it.

Positions are in OpenCV's camera frame (x right, y down, z forward) in `unit` (mm, cm or m). They are converted here to
the view frame in m. Lengths with names in `_mm` are always in mm. `intensity` is the signal of a perfectly white
Lambertian surface that faces the lamp at `reference_mm`, as a fraction of full scale, so albedo is absolute.

Optional fields are `black_level` (stored values, the same for all images; default zero), `position_sigma_mm` per axis
and `intensity_sigma` (a share), 1 σ of the stated lights, the camera's `full_well_e` (electrons at full scale) and
`read_noise_e`, from which the estimate of its noise starts, and `full_scale`, the stored value of 1.0, by default the
greatest that the files can hold. Other fields are not used; a warning names them.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import ConfigDict, Field

from acquisition import photometry
from acquisition.formats.folders import assembly, image_files
from acquisition.formats.folders.image_files import Progress
from acquisition.formats.folders.refusal import refusal, value
from acquisition.geometry import VIEW_FROM_CAMERA
from acquisition.models.base import BoolArray, FloatArray, Value, Vector3
from acquisition.models.calibration import is_camera_matrix
from acquisition.models.errors import RigError
from acquisition.normals.images.image_set import (
    INTENSITY_SIGMA,
    POSITION_SIGMA_M,
    READ_NOISE_E,
    Camera,
    ImageSet,
    NearLights,
    refuse_coplanar,
)

LIGHTS = "lights.json"
METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
MAX_OFF_AXIS_DEG = 70.0
"""Largest accepted angle between the optical axis and the middle of the images. Images that are cut out of larger ones
need not contain the axis."""

MAX_DISTORTION_ERROR_PX = 0.5
"""Largest accepted distance of a pixel from where its undistorted ray is seen: far below 0.01 px if the distortion can
be inverted there, else tens of pixels."""

MAX_DISTANCE_RATIO = 50.0
"""Largest accepted ratio of a lamp's and the camera's distances from the object, either way. Beyond it, one of the two
is in another unit: lamps are at 0.1 times (telephoto lens) to 30 times (microscope) the camera's distance."""


class _ForeignValue(Value):
    """Values of a file from elsewhere, which may contain further fields."""

    model_config = ConfigDict(extra="allow")

    def unknown(self, where: str = "") -> list[str]:
        """The names of fields that are not used."""
        return [where + name for name in self.model_extra or ()]


class _Camera(_ForeignValue):
    K: Annotated[tuple[Vector3, Vector3, Vector3], Field(strict=False)]
    distortion: list[float] = Field(default_factory=list[float])
    full_well_e: float | None = Field(default=None, gt=0)
    read_noise_e: float = Field(default=READ_NOISE_E, ge=0)


class _Light(_ForeignValue):
    file: str
    position: Vector3
    intensity: float = Field(gt=0)


class _Lights(_ForeignValue):
    unit: Literal["mm", "cm", "m"]
    reference_mm: float = Field(gt=0)
    camera: _Camera
    lights: list[_Light] = Field(min_length=1)
    depth_mm: float = Field(gt=0)
    black_level: int = Field(default=0, ge=0)
    full_scale: float | None = Field(default=None, gt=0)
    position_sigma_mm: float = Field(default=1000 * POSITION_SIGMA_M, gt=0)
    intensity_sigma: float = Field(default=INTENSITY_SIGMA, gt=0)


def read(path: Path, scratch: Path, progress: Progress | None = None) -> ImageSet:
    """Reads the folder of a `lights.json`. Raises RigError folder.invalid naming the file and the field."""
    given = value(path, _Lights)
    matrix = np.array(given.camera.K)
    if not is_camera_matrix(given.camera.K):
        raise refusal(path, "camera.K is not a camera matrix: give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")
    distortion = np.pad(given.camera.distortion, (0, 5))
    if np.any(distortion[5:]):
        raise refusal(
            path, "camera.distortion has more coefficients than k1 k2 p1 p2 k3: undistort the images and omit it"
        )
    names = [light.file for light in given.lights]
    if given.full_scale is not None and given.black_level >= given.full_scale:
        raise refusal(
            path, f"black_level {given.black_level} is not below full_scale {given.full_scale:g}: correct them"
        )
    # After subtraction of the black level, values are compared with full scale counted from zero.
    stored = image_files.open_images(path.parent, names, scratch, given.black_level, progress, given.full_scale)
    height, width = stored.size
    middle = np.array([width / 2, height / 2])
    off_axis = np.degrees(np.arctan(np.linalg.norm((middle - matrix[:2, 2]) / matrix[[0, 1], [0, 1]])))
    if off_axis > MAX_OFF_AXIS_DEG:
        raise refusal(
            path,
            f"camera.K has its centre far outside the {width} × {height} images, so their middle would be "
            f"{off_axis:.0f}° off the axis: correct it",
        )
    if _distortion_error_px(matrix, distortion[:5], width, height) > MAX_DISTORTION_ERROR_PX:
        raise refusal(
            path,
            f"camera.distortion {given.camera.distortion} cannot be inverted within the {width} × {height} images: "
            "correct it (OpenCV's k1 k2 p1 p2 k3, of coordinates over the focal length)",
        )
    warnings: list[str] = []
    unused = [*given.unknown(), *given.camera.unknown("camera."), *given.lights[0].unknown("lights.")]
    if unused:
        warnings.append(f"{LIGHTS} has fields that are not used: {', '.join(unused)}.")
    if "black_level" not in given.model_fields_set:
        warnings.append("No black level is given: it is taken as zero. Give `black_level` if the camera has one.")
    object_mask = assembly.mask_in(stored)
    if object_mask is None:
        warnings.append(f"There is no {assembly.MASK}: the object is looked for in the images.")
    lights = NearLights(
        np.array([light.position for light in given.lights]) @ VIEW_FROM_CAMERA[:3, :3].T * METRES[given.unit],
        np.array([light.intensity for light in given.lights]),
        given.reference_mm / 1000,
        position_sigma_m=given.position_sigma_mm / 1000,
        intensity_sigma=given.intensity_sigma,
    )
    toward = lights.positions_m - _place(path, given, lights, matrix, object_mask, stored.size)
    images = assembly.image_set(
        stored, lights, object_mask, kind="near light", warnings=warnings,
        irradiance=toward * (lights.intensity / np.linalg.norm(toward, axis=1) ** 3)[:, None],
        black_level=given.black_level,
    )  # fmt: skip
    return replace(
        images,
        saturated_from=images.saturated_from - given.black_level / stored.full_scale,
        camera=Camera(matrix, distortion[:5]),
        rough_depth_m=given.depth_mm / 1000,
        full_well_e=given.camera.full_well_e or images.full_well_e,
        read_noise_e=given.camera.read_noise_e,
    )


def _distortion_error_px(matrix: FloatArray, distortion: FloatArray, width: int, height: int) -> float:
    """Returns by how much pixels on the image's border, distorted again, miss themselves, at most."""
    sides = (
        (slice(0, 1), slice(0, width)), (slice(height - 1, height), slice(0, width)),
        (slice(0, height), slice(0, 1)), (slice(0, height), slice(width - 1, width)),
    )  # fmt: skip
    greatest = 0.0
    for rows, columns in sides:
        rays = photometry.camera_rays(matrix, distortion, rows, columns).reshape(2, -1).astype(np.float64)
        directions = np.concatenate([rays, np.ones((1, rays.shape[1]))]).T
        again, _ = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), matrix, distortion)
        row, column = np.mgrid[rows, columns]
        apart = again.reshape(-1, 2) - np.stack([column.ravel(), row.ravel()], axis=-1)
        greatest = max(greatest, float(np.max(np.linalg.norm(np.nan_to_num(apart, nan=np.inf), axis=-1))))
    return greatest


def _place(
    path: Path, given: _Lights, lights: NearLights, matrix: FloatArray, mask: BoolArray | None, size: tuple[int, int]
) -> FloatArray:
    """The object's rough position (3,), view frame, m: the middle of the mask or of the frame, at `depth_mm`.

    Raises RigError folder.invalid if the stated positions of lamps are impossible as seen from there. If that holds for
    most lamps, depth, unit or positions are wrong; if for a few, their positions.
    """
    row, column = np.mean(np.nonzero(np.ones(size, np.bool_) if mask is None else mask), axis=1)
    depth_m = given.depth_mm / 1000
    ray = np.array([(column - matrix[0, 2]) / matrix[0, 0], (row - matrix[1, 2]) / matrix[1, 1], 1.0])
    place = VIEW_FROM_CAMERA[:3, :3] @ (depth_m * ray)
    toward = lights.positions_m - place
    distance = np.linalg.norm(toward, axis=1)
    stated = f'depth_mm is {given.depth_mm:g} (in mm, whatever `unit` is), and `unit` is "{given.unit}"'
    remedy = "correct depth_mm, unit or the positions, whichever is wrong"
    far = (distance > MAX_DISTANCE_RATIO * depth_m) | (distance * MAX_DISTANCE_RATIO < depth_m)
    if np.count_nonzero(far) > len(far) / 2:
        lamps = f"{1000 * np.min(distance):.4g} to {1000 * np.max(distance):.4g} mm from the object"
        raise refusal(path, f"the lamps would be {lamps}, which is impossible: {stated}; {remedy}")
    if np.all(lights.positions_m[:, 2] <= -depth_m):
        raise refusal(
            path,
            f"all lamps would be behind the object, farther from the camera than it: {stated}; {remedy} (z points away "
            "from the camera)",
        )
    if np.any(far):
        number = int(np.argmax(far))
        raise refusal(
            path,
            f"lights.{number}.position is {1000 * distance[number]:.4g} mm from the object at a depth_mm of "
            f"{given.depth_mm:g}: correct whichever is wrong",
        )
    try:
        if len(toward) > 2:
            refuse_coplanar(toward)
    except RigError as error:
        detail = f"{path}: {error.detail}; if they really do not, {stated}: {remedy}"
        raise RigError(error.code, detail, file=str(path), **error.context) from error
    return place


def unit(folder: Path) -> Literal["mm", "cm", "m"]:
    """Reads the unit of the folder's positions. Raises RigError folder.invalid as `read` does."""
    return value(folder / LIGHTS, _Lights).unit
