"""Objects, their images, and what is tried of them: shared by the tests of the model selection."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest

from acquisition import normals, photometry
from acquisition.models.light_plan import Light
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals import Images
from acquisition.normals.alternatives import model_selection
from acquisition.normals.alternatives.alternative import Alternative
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.images import session_images
from hardware_sim.reflectance import Reflectance
from tests.acquisition import scenes
from tests.acquisition.normals.test_solve import ROUGH_DEPTH_M, two_rings

STRONG_FAULT_SIZE, SIZE, FULL_SIZE = 48, 64, 80
"""Pixels along an image of the cushion: for strong faults, the default, and for weak ones and long tests."""
SMOOTH_SIZE, FULL_SMOOTH_SIZE = 48, 64
"""Of dish and ball."""

Trial = tuple[Alternative, Solution, Solution]
"""An alternative, the solution before it, and its own."""
Tried = tuple[NormalMap, list[Trial]]
"""A result, and all that was tried for it."""


@cache
def object_of(height: scenes.Height, size: int) -> scenes.Scene:
    return scenes.scene(height, scenes.calibration(size))


@cache
def images_of(height: scenes.Height, size: int) -> Images:
    return read(object_of(height, size))


@cache
def sound_of(height: scenes.Height, size: int) -> Tried:
    """The result of sound images, and all that is tried for it."""
    with recorded_trials() as tried:
        return solved(object_of(height, size), images_of(height, size)), tried


def read(true: scenes.Scene, count: int = 8) -> Images:
    """Images with errors of 1 % and 1 mm."""
    known = true.calibration
    observations = scenes.capture(true, two_rings(count), seed=1)
    stack = session_images.read(observations, known, slice(0, known.height), slice(0, known.width))
    return stack


def solved(cushion: scenes.Scene, images: Images, *, thorough: bool = True) -> NormalMap:
    return normals.solve_stack(
        images, cushion.calibration, SolveSettings(), normals.ObjectPlace(ROUGH_DEPTH_M, silhouette=cushion.mask),
        thorough=thorough,
    )  # fmt: skip


def mean_deg(cushion: scenes.Scene, normal_map: NormalMap) -> float:
    return float(np.mean(cushion.error_deg(normal_map.normals)))


def kinds(normal_map: NormalMap) -> list[tuple[str, bool]]:
    return [(finding.kind, finding.corrected) for finding in normal_map.findings]


@contextmanager
def recorded_trials() -> Generator[list[Trial]]:
    """Every alternative that is tried while the context lasts."""
    tried: list[Trial] = []
    accepted = Alternative.accepted

    def recording(alternative: Alternative, before: Solution, trial: Solution) -> bool:
        tried.append((alternative, before, trial))
        return accepted(alternative, before, trial)

    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(Alternative, "accepted", recording)
        yield tried


@contextmanager
def recorded_solutions() -> Generator[list[Solution]]:
    """Every solution while the context lasts, the plain model's first."""
    solutions: list[Solution] = []
    solve = model_selection.solve

    def recording(hypothesis: Hypothesis) -> Solution:
        solutions.append(solve(hypothesis))
        return solutions[-1]

    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(model_selection, "solve", recording)
        yield solutions


def relit(lights: Sequence[Light], order: Sequence[int], mirror: tuple[int, int] = (1, 1)) -> tuple[Light, ...]:
    """The lights in another order, with x and y of positions and axes mirrored."""
    sign = np.array([*mirror, 1.0])
    return tuple(
        Light(
            position=tuple((sign * lights[number].position).tolist()), axis=tuple((sign * lights[number].axis).tolist())
        )
        for number in order
    )


def reflected(true: scenes.Scene, images: Images, reflectance: Reflectance) -> Images:
    """The Lambertian images times what another surface reflects of a Lambertian one at each pixel."""
    _, lamp, view = lit(true, images)
    rows, columns = np.nonzero(true.mask)
    normal, albedo = true.normals[rows, columns], np.full(len(rows), 0.5)
    plain, other = (one.value(normal, lamp, view, albedo) for one in (Reflectance(), reflectance))
    values = images.whole.values.copy()
    values[:, rows, columns] *= (other / np.maximum(plain, 1e-3)).astype(np.float32)
    return scenes.with_values(images, values)


def hollow(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A round dish."""
    r2 = (x**2 + y**2) / 0.055**2
    return np.where(r2 < 1, 0.012 + 0.02 * r2, 0.0)


def lit(true: scenes.Scene, images: Images) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Light vectors and unit vectors to the lamps (F, N, 3), and to the camera (N, 3), at the object's pixels."""
    known = true.calibration
    rows, columns = np.nonzero(true.mask)
    depth = true.depth[rows, columns].astype(np.float32)
    ray = photometry.rays(known, slice(0, known.height), slice(0, known.width))[:, rows, columns]
    point, along = photometry.points(ray, depth), photometry.ray_directions(ray)
    light = np.moveaxis(photometry.light_vectors(point, photometry.lamps(images.lights), known), 1, -1)
    lamp = light / np.linalg.norm(light, axis=-1, keepdims=True)
    return light, lamp, -along.T / np.linalg.norm(along.T, axis=1, keepdims=True)
