"""Sessions in the simulator without its arm: any light of the dome, immediately, with the errors of profile `direct`.

Only motion is omitted. Rendering, sensor, errors of each image, pilot, planner, patterns and solver are those of a
session in the simulated cell. One seed is one draw: it determines the object (shape and orientation) and the errors of
every image, which are keyed by the lamp's position. Methods that choose the same light therefore share its image, draws
are independent, and no result depends on the order of calls.

An image is rendered once per light, its shadows once for both finishes. The table, on which no figure depends, has one
sample per pixel.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from acquisition import geometry, normals, photometry, pilot, plan
from acquisition.capture import check, exposure
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.plan.candidate_lights import CandidateLights
from acquisition.session import max_passes
from api.cli.study.scene_geometry import Geometry
from hardware_sim import grade, render, sensor
from hardware_sim.render import Lamp
from hardware_sim.world import PROFILES

OBJECTS = ("sphere", "vase", "relief", "part", "bumps", "figure")
METHODS = ("optimal", "two-rings", "ring", "drbohlav", "max-distance", "paper", "random")
RING_SLANT_DEG = 35.0
PILOT_LIGHTS = 4

_PROFILE = PROFILES["direct"]
_VIEWING_AXIS = np.array([0.0, 0.0, 1.0], dtype=np.float32)


@dataclass(frozen=True)
class Frames:
    """Frames in memory, by path."""

    pixels: dict[str, npt.NDArray[np.uint16]]

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Returns rows [start, stop) of a frame."""
        return self.pixels[frame.path][start:stop]


@dataclass(frozen=True)
class SceneResult:
    """Images and normal map of one set of lights, and errors in degrees: (K,) of graded pixels, (J,) of mixed pixels.

    Mixed pixels are not graded, because they show two surfaces.
    """

    observations: Observations
    normal_map: NormalMap
    error_deg: FloatArray
    mixed_error_deg: FloatArray

    @property
    def mean_deg(self) -> float:
        """Mean error over the graded pixels, degrees."""
        return float(np.mean(self.error_deg))

    @property
    def all_error_deg(self) -> FloatArray:
        """Errors (K + J,) of graded and mixed pixels together, degrees."""
        return np.concatenate([self.error_deg, self.mixed_error_deg])


@dataclass(frozen=True)
class Run:
    """Result of a session with a recipe, and the plan of its last pass."""

    result: SceneResult
    plan: LightPlan


class Scene:
    """One draw: an object, diffuse or glossy, and the errors of all its images."""

    def __init__(self, shared: Geometry, *, glossy: bool = False) -> None:
        self.geometry, self.glossy = shared, glossy
        self.surface = shared.glossy if glossy else replace(shared.glossy, name=shared.shape, gloss=0.0)
        self._pictures: dict[tuple[object, ...], Float32Array] = {}
        self._results: dict[tuple[int | None, tuple[Light, ...]], SceneResult] = {}

    @property
    def calibration(self) -> Calibration:
        """The nominal calibration, without the errors."""
        return self.geometry.calibration

    @property
    def dome(self) -> CandidateLights:
        """Allowed positions of lights."""
        return self.geometry.dome

    @property
    def graded(self) -> BoolArray:
        """Pixels (H, W) over which errors are averaged: not at grazing view, and showing one surface."""
        return self.geometry.facing & self.geometry.one_surface

    @property
    def mixed(self) -> BoolArray:
        """Mixed pixels (H, W), not graded, because they show two surfaces and so have no single normal."""
        return self.geometry.facing & ~self.geometry.one_surface

    def capture(self, lights: Sequence[Light], unpredicted: int | None = None) -> Observations:
        """Captures one image for each light, exposed as in a session, and the lamp-off frames.

        The first `unpredicted` lights (None: all) are exposed without a prediction. For the others a normal map
        predicts the brightness of the object.
        """
        wanted, camera = Exposure(), self.geometry.cell.camera
        frames: dict[str, npt.NDArray[np.uint16]] = {}
        shots: list[Shot] = []
        darks: dict[float, Shot] = {}
        repeats: dict[tuple[object, ...], int] = {}
        for number, light in enumerate(lights):
            key = _position_key(light)
            repeat = repeats[key] = repeats.get(key, -1) + 1
            picture = self._picture(light, repeat)
            level = float(np.percentile(picture[self.geometry.region], check.BRIGHT_PERCENTILE))
            exposed = (
                exposure.for_level if unpredicted is None or number < unpredicted else exposure.for_predicted_level
            )
            seconds = exposed(level, wanted, camera)
            random = self._random("noise", key, repeat, seconds)
            frames[f"{number}.tiff"] = sensor.expose(picture * np.float32(seconds), self.calibration.sensor, random)
            shots.append(self._shot(f"{number}.tiff", number, seconds, light))
            if seconds not in darks:
                name = f"dark_{seconds!r}.tiff"
                random = self._random("dark", seconds)
                frames[name] = sensor.expose(np.zeros_like(picture), self.calibration.sensor, random)
                darks[seconds] = self._shot(name, len(lights) + len(darks), seconds, None)
        return Observations(shots, darks, Frames(frames))

    def solve(self, lights: Sequence[Light], unpredicted: int | None = None) -> SceneResult:
        """Solves the images under some lights with the final solver. Results are cached, because methods share lights.

        `unpredicted` is as for `capture`. A pixel without a normal counts with the error of the viewing axis, the best
        guess without data.
        """
        key = (None if unpredicted == len(lights) else unpredicted, tuple(lights))
        if key not in self._results:
            images = self.capture(lights, unpredicted)
            shared = self.geometry
            normal_map = normals.solve(
                images,
                self.calibration,
                SolveSettings(),
                shared.place,
            )
            best_guess = np.where(normal_map.mask[..., None], normal_map.normals, _VIEWING_AXIS)
            error_deg = grade.error_deg(best_guess, shared.truth)
            self._results[key] = SceneResult(images, normal_map, error_deg[self.graded], error_deg[self.mixed])
        return self._results[key]

    def run(self, recipe: Recipe) -> Run:
        """Runs a session with a recipe: a pattern at once, or a pilot, plans, and the planned lights."""
        if recipe.method != "optimal":
            chosen = plan.baseline(recipe.method, recipe.lights_total, recipe, self.dome)
            return Run(self.solve(chosen.lights), chosen)
        lights = pilot.pattern(recipe, self.dome)
        unpredicted = len(lights)
        chosen = LightPlan(lights=lights, method="pilot", reasons=["pilot"] * len(lights))
        for _ in range(max_passes(recipe) - 1):
            known = self.solve(lights, unpredicted)
            further = self._further(known, recipe)
            if not further.lights:
                return Run(known, further)
            chosen, lights = further, [*lights, *further.lights]
        return Run(self.solve(lights, unpredicted), chosen)

    def _further(self, known: SceneResult, recipe: Recipe) -> LightPlan:
        problem = plan.DesignProblem.of(known.normal_map, known.observations, recipe, self.dome, self.calibration)
        if recipe.target_sigma_deg is not None:
            return plan.plan_to_target(problem, photometry.mean_sigma_deg(known.normal_map, self.calibration))
        return plan.choose(problem, certify=False)

    def _picture(self, light: Light, repeat: int) -> Float32Array:
        """Renders the signal (H, W), fraction of full scale per second, with its errors of intensity and position."""
        key = (*_position_key(light), repeat)
        if key not in self._pictures:
            random = self._random("error", _position_key(light), repeat)
            known, object_from_view = self.calibration, self.geometry.object_from_view
            power = known.lamp_intensity * (1 + _PROFILE.intensity_sigma * random.normal())
            shift = _PROFILE.lamp_position_sigma_m * random.normal(size=3)
            lamp = Lamp(
                geometry.transform(object_from_view, np.array(light.position)) + shift,
                geometry.rotate(object_from_view, np.array(light.axis)),
                power,
                known.reference_m,
                known.lobe_exponent,
            )
            shared = self.geometry
            fine, coarse = (
                render.direct_image(view, self.surface, shared.tracer, lamp, free)
                for view, free in zip(shared.views, shared.illuminated(key, lamp), strict=True)
            )
            self._pictures[key] = fine + coarse
        return self._pictures[key]

    def _random(self, *key: object) -> np.random.Generator:
        text = repr((self.geometry.shape, self.geometry.seed, *key)).encode()
        return np.random.default_rng(int.from_bytes(hashlib.sha256(text).digest()[:16], "big"))

    def _shot(self, name: str, number: int, seconds: float, light: Light | None) -> Shot:
        known = self.calibration
        return Shot(
            key=ShotKey(pass_number=0, number=number),
            kind="dark" if light is None else "light",
            frame=FrameRef(path=name, width=known.width, height=known.height, sha256=""),
            exposure_s=seconds,
            light_number=None if light is None else number,
            light=light,
            lamp_on=light is not None,
            taken_at=0.0,
            quality=FrameQuality(saturated=0.0, bright_level=0.0, accepted=True),
        )


def recipe(method: str, lights: int, seed: int = 0) -> Recipe:
    """Returns the recipe of a method with a total number of lights, including the pilot's."""
    first = min(PILOT_LIGHTS, lights)
    return Recipe.model_validate(
        {
            "method": method,
            "pilot_lights": first,
            "planned_lights": lights - first,
            "slant_deg": RING_SLANT_DEG,
            "seed": seed,
        }
    )


def _position_key(light: Light) -> tuple[object, ...]:
    """Returns a lamp's position to a hundredth of a millimetre, as a key."""
    return tuple(round(value / 1e-5) for value in light.position)
