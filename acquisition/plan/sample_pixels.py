"""Sample pixels of a normal map, with the information of the images so far reweighted to the planner's noise model."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acquisition import image_values, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import FrameExposure
from acquisition.models.result import LIT, NormalMap
from acquisition.models.shot import Observations, Shot
from acquisition.plan import planned_images, visibility
from acquisition.plan.criterion import Samples, prior_information


def usable(normal_map: NormalMap, calibration: Calibration) -> np.ndarray:
    """Numbers of the information's pixels that a plan can use: those with finite values that error figures count."""
    information = normal_map.information
    rows, columns = information.rows, information.columns
    if not len(rows):
        return np.empty(0, dtype=np.int64)
    ray = visibility.rays_at(calibration, rows, columns)
    normal, depth = normal_map.normals[rows, columns], normal_map.depth[rows, columns]
    matrices = information.matrices.reshape(len(rows), -1)
    finite = np.isfinite(np.column_stack([matrices, normal, depth, normal_map.albedo[rows, columns]])).all(axis=1)
    counted = photometry.inside(normal_map.silhouette)[rows, columns]
    counted &= photometry.within_graded_slant(normal[None], ray[:, None])[0]
    return np.flatnonzero(finite & counted & (depth > 0))


def samples(
    normal_map: NormalMap, calibration: Calibration, chosen: np.ndarray,
    offset_sigma_m: float | None = None, observations: Observations | None = None,
) -> Samples:  # fmt: skip
    """Makes sample pixels of a normal map from the `chosen` numbers in its `information`.

    `offset_sigma_m` is 1 σ of the prior of their depth offsets, m; None: `depth_sigma_m`. With `observations`, the
    images so far, their information is reweighted.
    """
    rows, columns = normal_map.information.rows[chosen], normal_map.information.columns[chosen]
    ray = visibility.rays_at(calibration, rows, columns)
    depth = normal_map.depth[rows, columns]
    albedo = np.maximum(normal_map.albedo[rows, columns], 1e-3)
    offset_sigma_m = photometry.SETTINGS.depth_sigma_m if offset_sigma_m is None else offset_sigma_m
    scale = np.array([1.0, 1.0, 1.0, offset_sigma_m])
    information = normal_map.information.matrices[chosen] * np.outer(scale, scale)
    sample = Samples(
        row=rows,
        column=columns,
        point=photometry.points(ray, depth),
        ray_direction=photometry.ray_directions(ray),
        normal=np.ascontiguousarray(normal_map.normals[rows, columns].T),
        albedo=albedo,
        information=np.ascontiguousarray(np.moveaxis(information, 0, 2)) + prior_information(albedo),
        light_count=np.count_nonzero(normal_map.flags[:, rows, columns] & LIT, axis=0).astype(np.float32),
        indirect=np.zeros_like(albedo),
        margin=shadow_margins(np.radians(np.nan_to_num(normal_map.sigma_deg[rows, columns], nan=40.0))),
        offset_sigma_m=offset_sigma_m,
        regression_share=normal_map.noise.get("regression_share", 1.0),
    )
    return sample if observations is None else reweight(sample, normal_map, observations, calibration)


def shadow_margins(sigma_rad: FloatArray) -> FloatArray:
    """Margins (P,) of shadows where normals have σ (P,): a third of the pixels each gets −1 σ, 0 and 1 σ of the
    normal's component towards a light."""
    return (np.arange(len(sigma_rad)) % 3 - 1.0) * sigma_rad / np.sqrt(2.0)


def of_frames(frames: Sequence[Shot]) -> list[FrameExposure]:
    """Counts the frames of one light by exposure time."""
    times = Counter(shot.exposure_s for shot in frames)
    return [FrameExposure(exposure_s=seconds, frames=count) for seconds, count in sorted(times.items())]


def reweight(sample: Samples, normal_map: NormalMap, observations: Observations, calibration: Calibration) -> Samples:
    """Reweights each pixel's information from the solver's variances to the planner's, and fills in the mean indirect
    part of the images. Raises RigError plan.infeasible if the normals are of another number of images."""
    shots = observations.lit
    if not shots:
        return sample
    if len(shots) != len(normal_map.flags):
        counts = f"the normals were solved from {len(normal_map.flags)} images, the session has {len(shots)}"
        raise RigError(ErrorCode.PLAN_INFEASIBLE, f"{counts}: plan from the result of all images")
    shaded = planned_images.shading(sample, [light for _, light in shots], calibration)
    frames = [of_frames(observations.frames_of(shot)) for shot, _ in shots]
    sensor, _ = planned_images.sensor_variance(shaded.value, frames, calibration)
    lit = normal_map.flags[:, sample.row, sample.column] & LIT > 0
    indirect = np.zeros_like(sample.albedo)
    if normal_map.indirect is not None:
        share = np.clip(normal_map.indirect[sample.row, sample.column], 0, 0.5)  # no brighter than the direct light
        indirect = np.asarray(np.mean(np.where(lit, shaded.value, 0), axis=0) * share / (1 - share), np.float32)
    none = np.zeros(len(lit))
    usual = image_values.model_noise(calibration, none, none, float(np.mean(shaded.distance)))
    intensity = normal_map.noise.get("intensity", usual.intensity) * shaded.value
    direction = normal_map.noise.get("direction", usual.direction) * shaded.strength
    predicted = photometry.SETTINGS.predicted_indirect_sigma * indirect
    assumed = sensor + intensity**2 + direction**2 + predicted**2
    sample = replace(sample, indirect=indirect)
    expected = planned_images.variance(shaded, sensor, calibration, sample)
    before = np.sum(np.where(lit, shaded.strength**2 / assumed, 0.0), axis=0)
    after = np.sum(np.where(lit, shaded.strength**2 / expected, 0.0), axis=0)
    scale = np.divide(after, before, out=np.ones_like(before), where=before > 0)
    prior = prior_information(sample.albedo)
    return replace(sample, information=(sample.information - prior) * scale + prior)
