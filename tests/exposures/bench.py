"""Sessions in the simulator without its arm, with one automatic exposure of each light or with planned exposures.

A draw is an object (shape, orientation, albedo, gloss) with the errors of all images, as in `lightpose study`: errors
of intensity and position belong to the light, whatever frames its image is made of, and each frame has noise of its
own. Both kinds of session have the same pilot positions and the same errors of the same lights. Time is counted alike:
a move for each light, each frame's exposure and readout, and the lamp-off frames of each pass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry, pilot, plan
from acquisition.capture import check, exposure
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals.images import session_images
from acquisition.normals.solve import solve_stack
from acquisition.normals.uncertainty import sensor_estimate
from acquisition.plan.exposure_plan import CaptureTimes
from acquisition.runner import jobs
from acquisition.session import further_number
from api.cli.study.scene_geometry import Geometry
from api.cli.study.simulated_scene import Frames, Scene
from hardware_sim import grade, objects, sensor

MOVE_S = 2.1
"""Time of a light without its frames, s: less than in the simulated cell (2.6 s of eight lights, 3.8 s of four, with
settling, lamp and the way home), so that the comparison rather favours one exposure and more lights."""

PILOT_LIGHTS = 4

FINISHES = ("soft", "textured", "contrast")
"""`contrast`: patches of albedo 0.03 and 0.9 under a thin gloss; the others are the built-in objects' own."""


@dataclass(frozen=True)
class Outcome:
    """A session: images, capture time, mean error and σ over the graded pixels (degrees), and how well σ is
    calibrated: share of errors below it, rms of error over σ."""

    lights: int
    seconds: float
    error_deg: float
    sigma_deg: float
    within_sigma: float
    rms_over_sigma: float
    dark_error_deg: float


def scene(shape: str, finish: str, seed: int, pixels: int, gloss: float | None = None) -> Scene:
    """A draw of an object with a finish."""
    made = Scene(Geometry(shape, seed, pixels))
    finished = objects.build(shape if finish == "soft" else f"{shape}-{finish}", seed)
    gloss = finished.gloss if gloss is None else gloss
    made.surface = replace(
        made.surface, texture=finished.texture, gloss=gloss, gloss_exponent=finished.gloss_exponent
    )  # fmt: skip
    views = made.geometry.views  # traced with the glossy finish, of which the samples hold the albedo
    points = views[0].surface.points
    coloured = replace(views[0].surface, albedo=np.asarray(finished.texture(points), np.float32))
    made.geometry.__dict__["views"] = (replace(views[0], surface=coloured), views[1])
    return made


class Sessions:
    """The sessions of one draw."""

    def __init__(self, drawn: Scene, seed: int) -> None:
        self.scene, self.seed = drawn, seed
        camera = drawn.geometry.cell.camera
        self.times = CaptureTimes(camera.min_exposure_s, camera.max_exposure_s, MOVE_S, jobs.FRAME_S)

    def run(self, wanted: Exposure, planned: int) -> Outcome:
        """A session with a pilot and `planned` lights."""
        recipe = Recipe(exposure=wanted, pilot_lights=PILOT_LIGHTS, planned_lights=planned, seed=self.seed)
        lights = pilot.pattern(recipe, self.scene.dome)
        known = [self._unplanned(light, wanted) for light in lights]
        images = self._capture(lights, known, PILOT_LIGHTS)
        problem = plan.DesignProblem.of(self._solve(images), images, recipe, self.scene.dome, self.scene.calibration)
        chosen = plan.choose(problem, certify=False, times=self.times)
        further = [
            [self._predicted(light, wanted)] if chosen.exposures is None else list(chosen.exposures[number].frames)
            for number, light in enumerate(chosen.lights)
        ]
        images = self._capture([*lights, *chosen.lights], [*known, *further], PILOT_LIGHTS)
        seconds = self.times.of_pass(known) + self.times.of_pass(further)
        return self._grade(self._solve(images), len(images.shots), seconds)

    def _level(self, light: Light) -> float:
        picture = self.scene._picture(light, 0)
        return float(np.percentile(picture[self.scene.geometry.region], check.BRIGHT_PERCENTILE))

    def _unplanned(self, light: Light, wanted: Exposure) -> list[FrameExposure]:
        camera = self.scene.geometry.cell.camera
        seconds = exposure.for_level(self._level(light), wanted, camera)
        times = [seconds, *exposure.further_times(seconds, wanted, camera)]
        return [FrameExposure(exposure_s=one) for one in times]

    def _predicted(self, light: Light, wanted: Exposure) -> FrameExposure:
        camera = self.scene.geometry.cell.camera
        return FrameExposure(exposure_s=exposure.for_predicted_level(self._level(light), wanted, camera))

    def _capture(self, lights: list[Light], exposures: list[list[FrameExposure]], first: int) -> Observations:
        """Images of lights with their exposures; the first pass has the `first` of them."""
        known = self.scene.calibration
        frames: dict[str, np.ndarray] = {}
        shots: list[Shot] = []
        off = np.zeros((known.height, known.width), np.float32)

        def take(key: ShotKey, kind: str, seconds: float, light: Light | None, of: int | None) -> None:
            picture = off if light is None else self.scene._picture(light, 0)
            name = f"{key.pass_number}_{key.number}"
            where = () if light is None else tuple(round(value / 1e-5) for value in light.position)
            random = self.scene._random("frame", where, seconds, 0 if kind == "light" else key.number)
            frames[name] = sensor.expose(picture * np.float32(seconds), known.sensor, random)
            frame = FrameRef(path=name, width=known.width, height=known.height, sha256="")
            quality = FrameQuality(saturated=0.0, bright_level=0.0, accepted=True)
            shot = Shot(
                key=key, kind="light", frame=frame, exposure_s=seconds, light_number=of, light=light,
                lamp_on=light is not None, taken_at=0.0, quality=quality,
            )  # fmt: skip
            shots.append(shot.model_copy(update={"kind": kind}))

        for number, (light, wanted) in enumerate(zip(lights, exposures, strict=True)):
            pass_number, of = (0, number) if number < first else (1, number - first)
            times = [one.exposure_s for one in wanted for _ in range(one.frames)]
            for index, seconds in enumerate(times):
                key = ShotKey(pass_number=pass_number, number=of if index == 0 else further_number(of, index - 1))
                take(key, "bracket" if index else "light", seconds, light, of)
        for number, seconds in enumerate(sorted({shot.exposure_s for shot in shots})):
            take(ShotKey(pass_number=1, number=500 + number), "dark", seconds, None, None)
        return Observations.of(shots, Frames(frames))

    def _solve(self, images: Observations) -> NormalMap:
        """Solves with the object's mask given: dark parts are as dark as the table, and look alike."""
        shared, known = self.scene.geometry, self.scene.calibration
        rows, columns = photometry.bounding_box(shared.region)
        known = sensor_estimate.estimate(images, known, rows, columns).calibration
        return solve_stack(
            session_images.read(images, known, rows, columns), known, SolveSettings(),
            replace(shared.place, silhouette=shared.truth.mask),
        )  # fmt: skip

    def _grade(self, solved: NormalMap, lights: int, seconds: float) -> Outcome:
        graded = self.scene.graded
        guess = np.where(solved.mask[..., None], solved.normals, np.array([0, 0, 1], np.float32))
        error = grade.error_deg(guess, self.scene.geometry.truth)[graded]
        sigma = np.nan_to_num(solved.sigma_deg, nan=40.0)[graded]
        albedo = np.zeros(graded.size)
        centres = self.scene.geometry.centres
        albedo[centres.pixels] = self.scene.surface.texture(centres.points)
        dark = albedo.reshape(graded.shape)[graded] < np.median(albedo[albedo > 0]) / 2
        return Outcome(
            lights=lights, seconds=seconds, error_deg=float(np.mean(error)), sigma_deg=float(np.mean(sigma)),
            within_sigma=float(np.mean(error < sigma)), rms_over_sigma=float(np.sqrt(np.mean((error / sigma) ** 2))),
            dark_error_deg=float(np.mean(error[dark])) if np.any(dark) else float("nan"),
        )  # fmt: skip


def at_time(outcomes: Sequence[Outcome], seconds: float, what: str) -> float:
    """A figure of sessions of several numbers of lights at a capture time, interpolated in logarithms."""
    ordered = sorted(outcomes, key=lambda one: one.seconds)
    x, y = (np.log([getattr(one, name) for one in ordered]) for name in ("seconds", what))
    return float(np.exp(_line(np.log(seconds), x, y)))


def time_for(outcomes: Sequence[Outcome], value: float, what: str) -> float:
    """The capture time at which sessions of several numbers of lights reach a figure, by a line in logarithms."""
    x, y = (np.log([getattr(one, name) for one in outcomes]) for name in ("seconds", what))
    slope, constant = np.polyfit(x, y, 1)
    return float(np.exp((np.log(value) - constant) / slope))


def _line(at: float, x: np.ndarray, y: np.ndarray) -> float:
    """Linear interpolation, beyond the ends by the line through all points."""
    if x[0] <= at <= x[-1]:
        return float(np.interp(at, x, y))
    slope, constant = np.polyfit(x, y, 1)
    return float(slope * at + constant)
