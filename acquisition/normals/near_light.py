"""Near-light images of any source for the session's own solver: normalised values, a camera, uncertainties.

A folder has no sensor model and usually states no uncertainty of its lights. The sensor's noise is estimated from
differences between residuals of neighbouring pixels; if that fails, the image set's assumption stays. The uncertainty
of the lights is the image set's assumption as well, which the solver corrects by the residuals. The three channels of
colour images are measurements of one normal with one albedo each (`colour_channels`).
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import HIGHLIGHT, LIT, NormalMap, SolveSettings
from acquisition.normals.images import colour_albedo, colour_channels
from acquisition.normals.images.image_set import ImageSet, NearLights
from acquisition.normals.images.normalised_images import ImageBlock, Images, held_if_small, row_blocks
from acquisition.normals.solve import ObjectPlace, solve_stack
from acquisition.normals.uncertainty import pixel_noise


def solve(images: ImageSet, settings: SolveSettings, *, thorough: bool = True) -> NormalMap:
    """Solves images with NearLights and a camera by near-light photometric stereo.

    A given mask is taken as the object's whole silhouette; otherwise the object is segmented in the images. `thorough`
    is explained in `Hypothesis`. Raises RigError normals.infeasible as `solve_stack` does, and if lights' positions,
    camera or depth are missing or no pixel can be solved.
    """
    calibration = calibration_of(images)
    depth = images.rough_depth_m
    if depth is None:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "near light needs the object's rough depth: give depth_mm")
    window = windowed_images(images)
    inside = (window.rows, window.columns)
    rough = np.broadcast_to(np.asarray(depth, np.float32), images.mask.shape)[inside]
    window, note = pixel_noise.estimate(window, images.mask[inside], rough, calibration, _quantisation_step(images))
    normal_map = solve_stack(
        window,
        calibration,
        settings,
        ObjectPlace(depth, silhouette=images.mask if images.mask_given else None),
        thorough=thorough,
    )
    if not np.any(normal_map.mask):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "no pixel could be solved: check the mask, the lights and, for near light, the object's rough depth",
        )
    notes = {"sensor": note} | ({} if images.mask_given else {"mask": "proposed"})
    normal_map = replace(normal_map, notes=normal_map.notes | notes)
    return normal_map if images.channels == 1 else _with_colours(normal_map, images)


def _with_colours(normal_map: NormalMap, images: ImageSet) -> NormalMap:
    """Adds each channel's albedo (H, W, 3) to the result, from lit measurements without highlights."""
    light = lights_of(images).of_channels(images.channels)
    colours = np.zeros((images.height, images.width, 3), np.float32)
    for rows in row_blocks(images.height):
        if not np.any(normal_map.mask[rows]):
            continue
        values = np.stack([images.values(index, rows.start, rows.stop) for index in range(images.count)])
        usable = (normal_map.flags[:, rows] & (LIT | HIGHLIGHT)) == LIT
        usable &= np.all(values < images.saturated_from, axis=-1)
        colours[rows] = normal_map.albedo[rows, :, None] * colour_channels.ratios(values, usable, light)
    colours[~normal_map.mask] = 0
    return replace(normal_map, albedo_rgb=colours, notes=normal_map.notes | {"colour": colour_albedo.CAMERA})


def windowed_images(images: ImageSet) -> Images:
    """Normalises the images within the mask's window: y = 1 is white facing the lamp at its reference distance."""
    lights = lights_of(images)
    rows, columns = photometry.bounding_box(images.mask)
    read = images.read_noise_e / images.full_well_e / lights.intensity
    floor = (read**2 + _quantisation_step(images) ** 2 / 12) / images.channels
    middle = np.array([0.0, 0.0, -(images.rough_depth_m or 1.0)])
    return held_if_small(
        Images(
            read=_Rows(images, lights.of_channels(images.channels), rows, columns),
            lights=tuple(lamp_pose.light_at(place, middle) for place in lights.positions_m),
            rows=rows,
            columns=columns,
            shot=1 / (images.full_well_e * images.channels * lights.intensity),
            floor=floor,
            labels=images.labels,
            metric=images.metric,
        )
    )


def lights_of(images: ImageSet) -> NearLights:
    """Returns the near lights of the images. Raises RigError normals.infeasible if the lights are directions."""
    if not isinstance(images.lights, NearLights):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "near light needs lamp positions, but the lights are directions: give positions, or solve as distant light",
        )
    return images.lights


def _quantisation_step(images: ImageSet) -> FloatArray:
    """Returns the quantisation step (F,) of each image's values, 0 for floating-point values."""
    intensity = lights_of(images).intensity
    return 1 / (images.full_scale * intensity) if images.quantised else np.zeros_like(intensity)


@dataclass(frozen=True)
class _Rows:
    """Reads rows of a window of images, divided by their light (F, C), with colours combined to one value."""

    images: ImageSet
    light: FloatArray
    rows: slice
    columns: slice

    def __call__(self, start: int, stop: int) -> ImageBlock:
        lines = self.rows.start + start, self.rows.start + stop
        size = (self.images.count, stop - start, self.columns.stop - self.columns.start, self.images.channels)
        values = np.empty(size, np.float32)
        for index in range(self.images.count):
            values[index] = self.images.values(index, *lines)[:, self.columns].reshape(size[1:])
        clipped = values >= self.images.saturated_from
        if self.images.channels > 1:
            return ImageBlock(*colour_channels.combined(values, clipped, self.light))
        values /= self.light.astype(np.float32)[:, None, None]
        return ImageBlock(values[..., 0], clipped[..., 0])


def calibration_of(images: ImageSet) -> Calibration:
    """Builds a calibration with isotropic lamps from an image set's camera and lights.

    Raises RigError normals.infeasible if there is no camera or if the lights are directions.
    """
    lights, camera = lights_of(images), images.camera
    if camera is None:
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "near light needs a calibrated camera: give the camera matrix")
    identity = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    bits = int(np.clip(round(np.log2(max(images.full_scale, 1.0) + 1)), 8, 16))
    first, second, third = (tuple(float(value) for value in row) for row in camera.matrix)
    k1, k2, p1, p2, k3 = (float(value) for value in camera.distortion)
    return Calibration(
        width=images.width,
        height=images.height,
        camera_matrix=(first, second, third),  # pyright: ignore[reportArgumentType] - three of three each
        distortion=(k1, k2, p1, p2, k3),
        base_from_camera=identity,
        tool_from_lamp=identity,
        lamp_intensity=1.0,
        reference_m=lights.reference_m,
        lobe_exponent=0.0,
        sensor=SensorModel(
            bits=bits,
            gain_e_per_dn=images.full_well_e / (2**bits - 1),  # full scale is the converter's end
            read_noise_e=images.read_noise_e,
            full_well_e=images.full_well_e,
            black_level_dn=0.0,
        ),
        intensity_sigma=lights.intensity_sigma,
        lamp_position_sigma_m=lights.position_sigma_m,
        made_at="1970-01-01T00:00:00+00:00",  # unknown, and not needed here
        valid_days=1.0,
    )
