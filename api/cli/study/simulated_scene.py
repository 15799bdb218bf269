"""Scenes of the simulator without its arm: any light of the dome, at once, with the errors of profile `direct`.

What is left out is only the way: pictures, sensor, errors of each image, pilot, planner, patterns and solver are those
of a session in the simulated cell. One seed is one draw: it makes the object (its shape and how it is turned) and the
errors of every image, which are keyed by where the lamp stands. So methods that choose the same light share its image,
draws are independent, and no result depends on the order of calls.

A picture is rendered once for each light, its shadows once for matt and glossy ones; the table, which nobody looks at,
with one sample for each pixel.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import geometry, normals, pilot, plan
from acquisition.capture import check, exposure, region
from acquisition.models import cell_config
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.route import Refusal
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.session import max_passes
from acquisition.waypoints.roadmap import dome_center, dome_lights
from hardware_sim import footprint, grade, nominal, objects, render, sensor
from hardware_sim.render import Lamp, Lens, View
from hardware_sim.tracing import Tracer
from hardware_sim.truth import Truth
from hardware_sim.world import PROFILES

OBJECTS = ("sphere", "vase", "relief", "part", "bumps", "figure")
METHODS = ("optimal", "two-rings", "ring", "drbohlav", "max-distance", "paper", "random")
RING_SLANT_DEG = 35.0
PILOT_LIGHTS = 4
PIXELS = 256
"""Below, mixed pixels at edges decide the mean errors of the objects with steps, whatever the lights."""
SUBDIVISION = 3
KEPT = 3
"""Geometries that a process keeps."""

NEAR_OBJECT_PX = 2
"""Table pixels this close to the object are sampled like it: they may be taken for its edge."""

_PROFILE = PROFILES["direct"]
_VIEWING_AXIS = np.array([0.0, 0.0, 1.0], dtype=np.float32)


@dataclass(frozen=True)
class Frames:
    """Frames in memory, by path."""

    pixels: dict[str, npt.NDArray[np.uint16]]

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame."""
        return self.pixels[frame.path][start:stop]


@dataclass(frozen=True)
class WholeDome:
    """A reach that refuses nothing on the cell's dome; implements `types.Reach`."""

    candidates: FloatArray
    center: FloatArray
    radius_m: float
    largest_slant_rad: float

    def allows(self, position: FloatArray) -> Refusal | None:
        """None on the dome's cap."""
        slant, _ = geometry.slant_azimuth(np.asarray(position, dtype=float) - self.center)
        if slant <= self.largest_slant_rad + 1e-9:
            return None
        return Refusal(reason="too-far", detail=f"slant {np.degrees(slant):.0f}° is below the dome's rim")


@dataclass(frozen=True)
class Found:
    """What one set of lights gave: images, normal map, and the error of each pixel in degrees, (K,) of those that are
    graded and (J,) of those that are not because they straddle two surfaces."""

    observations: Observations
    normal_map: NormalMap
    error_deg: FloatArray
    straddling_deg: FloatArray

    @property
    def mean_deg(self) -> float:
        """Mean error over the graded pixels."""
        return float(np.mean(self.error_deg))

    @property
    def all_deg(self) -> FloatArray:
        """The errors (K + J,) of graded and straddling pixels together."""
        return np.concatenate([self.error_deg, self.straddling_deg])


@dataclass(frozen=True)
class Run:
    """What a session with some recipe would have found, and the plan of its last pass."""

    found: Found
    plan: LightPlan


class Geometry:
    """One object under the nominal camera, traced: what matt and glossy versions and all lights share."""

    def __init__(self, shape: str, seed: int, pixels: int = PIXELS) -> None:
        self.shape, self.seed = shape, seed
        self.cell = cell_config.load(nominal.default_cell_file())
        self.calibration = nominal.calibration(pixels)
        self.glossy = objects.build(f"{shape}-glossy", seed)
        self.tracer = Tracer(self.glossy.mesh)
        self._reached: dict[tuple[object, ...], list[npt.NDArray[np.uint8]]] = {}
        keep_out = self.cell.object.keep_out
        self.object_from_base = geometry.inverse(keep_out.base_from_object.matrix)
        known = self.calibration
        self.lens = Lens(
            known.width,
            known.height,
            np.array(known.camera_matrix),
            np.array(known.distortion),
            self.object_from_base @ np.array(known.base_from_camera),
        )
        self.region = region.keep_out(self.cell, known)
        self.initial_depth_m = region.middle_depth_m(self.cell, known)
        self.table_depth_m = region.table_depth_m(self.cell, known)
        center = dome_center(self.cell, known)
        lights = dome_lights(self.cell, known, self.cell.dome.candidates)
        self.dome = WholeDome(
            np.array([light.position for light in lights]),
            center,
            self.cell.dome.radius_m,
            float(np.radians(self.cell.dome.max_slant_deg)),
        )

    @cached_property
    def views(self) -> tuple[View, View]:
        """What the camera sees: object and its surroundings finely, the rest of the region's table coarsely."""
        fine = render.trace_view(self.glossy, self.tracer, self.lens, SUBDIVISION)
        covered = np.zeros(self.region.shape, np.uint8)
        covered.ravel()[fine.surface.pixels] = 1
        size = 2 * NEAR_OBJECT_PX + 1
        near = cv2.dilate(covered, np.ones((size, size), np.uint8)).astype(bool)
        coarse = render.trace_view(self.glossy, self.tracer, self.lens, 1)
        nothing = _only(coarse.surface, np.zeros(near.shape, bool))
        return (
            replace(fine, table=_only(fine.table, near)),
            replace(coarse, surface=nothing, table=_only(coarse.table, self.region & ~near)),
        )

    def reached(self, key: tuple[object, ...], lamp: Lamp) -> list[tuple[BoolArray, BoolArray]]:
        """What `render.reached` says of each view; kept under the lamp's key, a bit for each sample."""
        fine, coarse = self.views
        parts = (fine.surface, fine.table, coarse.surface, coarse.table)
        if key not in self._reached:
            told = [self._surface_reached(lamp), *(self._lit(samples, lamp) for samples in parts[1:])]
            self._reached[key] = [np.packbits(one) for one in told]
        free = [
            np.unpackbits(one, count=len(samples.pixels)).view(np.bool_)
            for one, samples in zip(self._reached[key], parts, strict=True)
        ]
        return [(free[0], free[1]), (free[2], free[3])]

    def _lit(self, samples: render.Samples, lamp: Lamp, chosen: np.ndarray | slice = slice(None)) -> BoolArray:
        return render.lit_mask(samples.points[chosen], samples.normals[chosen], lamp.position, self.tracer, self.glossy)

    def _surface_reached(self, lamp: Lamp) -> BoolArray:
        """Which samples of the object a lamp shines on; shadow rays lead from all samples of a pixel only where those
        of its centre and the centres round it differ: one sample in ten thousand comes out otherwise."""
        shape = (self.lens.height, self.lens.width)
        centres, samples = self.centres, self.views[0].surface
        free = self._lit(centres, lamp)
        lit, dark = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        lit.ravel()[centres.pixels] = free
        dark.ravel()[centres.pixels] = ~free & _faces(centres, lamp)
        round_it = np.ones((3, 3), np.uint8)
        bright, shadowed = (cv2.erode(one, round_it).ravel()[samples.pixels] > 0 for one in (lit, dark))
        out = bright & _faces(samples, lamp)
        unsure = np.flatnonzero(~(bright | shadowed))
        out[unsure] = self._lit(samples, lamp, unsure)
        return out

    @cached_property
    def centres(self) -> render.Samples:
        """What the rays through the pixel centres hit, object frame."""
        rows, columns = np.divmod(np.arange(self.lens.height * self.lens.width, dtype=float), self.lens.width)
        return render.object_samples(self.glossy, self.tracer, self.lens.eye, self.lens.directions(columns, rows))

    @cached_property
    def truth(self) -> Truth:
        """What is true at the pixel centres, view frame."""
        height, width = self.lens.height, self.lens.width
        seen = self.centres
        view_from_object = geometry.inverse(self.object_from_view)
        true_normals = np.zeros((height, width, 3), np.float32)
        depth, albedo, mask = (np.zeros((height, width), kind) for kind in (np.float32, np.float32, bool))
        true_normals.reshape(-1, 3)[seen.pixels] = geometry.rotate(view_from_object, seen.normals)
        depth.ravel()[seen.pixels] = -geometry.transform(view_from_object, seen.points)[:, 2]
        albedo.ravel()[seen.pixels] = seen.albedo
        mask.ravel()[seen.pixels] = True
        return Truth(true_normals, depth, albedo, mask)

    @cached_property
    def facing(self) -> BoolArray:
        """Pixels (H, W) within the silhouette that the surface is not seen edge-on in."""
        return grade.graded_pixels(self.truth, self.calibration)

    @cached_property
    def one_surface(self) -> BoolArray:
        """Pixels (H, W) that have one true normal."""
        return footprint.one_surface(self.centres, self.glossy, self.tracer, self.lens)

    @property
    def object_from_view(self) -> FloatArray:
        """The pose (4, 4) of the view frame."""
        return self.object_from_base @ geometry.base_from_view(np.array(self.calibration.base_from_camera))


@lru_cache(maxsize=KEPT)
def traced(shape: str, seed: int, pixels: int = PIXELS) -> Geometry:
    """The geometry of one draw; the last few are kept, because the study's parts ask for the same ones."""
    return Geometry(shape, seed, pixels)


class Scene:
    """One draw: an object, matt or glossy, and the errors of every image that may be taken of it."""

    def __init__(self, shared: Geometry, *, glossy: bool = False) -> None:
        self.geometry, self.glossy = shared, glossy
        self.surface = shared.glossy if glossy else replace(shared.glossy, name=shared.shape, gloss=0.0)
        self._pictures: dict[tuple[object, ...], Float32Array] = {}
        self._found: dict[tuple[int | None, tuple[Light, ...]], Found] = {}

    @property
    def calibration(self) -> Calibration:
        """The nominal calibration, which does not know the errors."""
        return self.geometry.calibration

    @property
    def dome(self) -> WholeDome:
        """Where lights may be."""
        return self.geometry.dome

    @property
    def graded(self) -> BoolArray:
        """Pixels (H, W) over which errors are taken: those not seen edge-on that show one surface."""
        return self.geometry.facing & self.geometry.one_surface

    @property
    def straddling(self) -> BoolArray:
        """Pixels (H, W) that are left out because they show two surfaces and so have no one normal."""
        return self.geometry.facing & ~self.geometry.one_surface

    def capture(self, lights: Sequence[Light], unforeseen: int | None = None) -> Observations:
        """One image for each light, exposed as a session would, and the lamp-off frames.

        So many first lights are `unforeseen`, none: all; the others are planned on a normal map that foretells how
        bright they make the object.
        """
        wanted, camera = Exposure(), self.geometry.cell.camera
        frames: dict[str, npt.NDArray[np.uint16]] = {}
        shots: list[Shot] = []
        darks: dict[float, Shot] = {}
        before: dict[tuple[object, ...], int] = {}
        for number, light in enumerate(lights):
            key = _place(light)
            repeat = before[key] = before.get(key, -1) + 1
            picture = self._picture(light, repeat)
            level = float(np.percentile(picture[self.geometry.region], check.BRIGHT_PERCENTILE))
            exposed = exposure.for_level if unforeseen is None or number < unforeseen else exposure.for_predicted_level
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

    def found(self, lights: Sequence[Light], unforeseen: int | None = None) -> Found:
        """What the final solver makes of the images under these lights; kept, because methods share them.

        `unforeseen` as for `capture`. A pixel without a normal counts with the error of the viewing axis, which is what
        nothing known amounts to.
        """
        key = (None if unforeseen == len(lights) else unforeseen, tuple(lights))
        if key not in self._found:
            taken = self.capture(lights, unforeseen)
            shared = self.geometry
            normal_map = normals.solve(
                taken,
                self.calibration,
                SolveSettings(),
                initial_depth_m=shared.initial_depth_m,
                region=shared.region,
                table_depth_m=shared.table_depth_m,
            )
            best_guess = np.where(normal_map.mask[..., None], normal_map.normals, _VIEWING_AXIS)
            error_deg = grade.error_deg(best_guess, shared.truth)
            self._found[key] = Found(taken, normal_map, error_deg[self.graded], error_deg[self.straddling])
        return self._found[key]

    def run(self, recipe: Recipe) -> Run:
        """What a session with this recipe finds: a pattern at once, or a pilot, plans, and the planned lights."""
        if recipe.method != "optimal":
            chosen = plan.baseline(recipe.method, recipe.lights_total, recipe, self.dome)
            return Run(self.found(chosen.lights), chosen)
        lights = pilot.pattern(recipe, self.dome)
        unforeseen = len(lights)
        chosen = LightPlan(lights=lights, method="pilot", reasons=["pilot"] * len(lights))
        for _ in range(max_passes(recipe) - 1):
            known = self.found(lights, unforeseen)
            further = self._further(known, recipe)
            if not further.lights:
                return Run(known, further)
            chosen, lights = further, [*lights, *further.lights]
        return Run(self.found(lights, unforeseen), chosen)

    def _further(self, known: Found, recipe: Recipe) -> LightPlan:
        arguments = (known.normal_map, known.observations, recipe, self.dome, self.calibration)
        return plan.choose(*arguments, certify=False) if recipe.target_sigma_deg is None else plan.approach(*arguments)

    def _picture(self, light: Light, repeat: int) -> Float32Array:
        """Signal (H, W), fraction of full scale per second, with the image's own error of intensity and position."""
        key = (*_place(light), repeat)
        if key not in self._pictures:
            random = self._random("error", _place(light), repeat)
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
                for view, free in zip(shared.views, shared.reached(key, lamp), strict=True)
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
    """The recipe of a method with so many lights in all, the pilot's included."""
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


def _place(light: Light) -> tuple[object, ...]:
    """A lamp's place to a hundredth of a millimetre, as a key."""
    return tuple(round(value / 1e-5) for value in light.position)


def _faces(samples: render.Samples, lamp: Lamp) -> BoolArray:
    """Which samples face a lamp."""
    to_lamp = lamp.position.astype(np.float32) - samples.points
    return np.einsum("ni,ni->n", to_lamp, samples.normals) > 0


def _only(samples: render.Samples, where: BoolArray) -> render.Samples:
    kept = where.ravel()[samples.pixels]
    return render.Samples(samples.pixels[kept], samples.points[kept], samples.normals[kept], samples.albedo[kept])
