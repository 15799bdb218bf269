"""A complete session in one process: its stages in order, on frames of the simulated world.

What is left out is what must change nothing: sockets, ur-rtde, the arm's motion, the service, its journal and files.
Reach, routes, the arm's kinematics, exposures, planner and solver are those of a session, in the session's order. The
world keys the errors of an image by where the arm stands, so that a session over HTTP finds the same normals, and a
comparison of many sessions takes an eighth of the time.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import numpy.typing as npt

from acquisition import lamp_pose, normals, pilot, plan
from acquisition.capture import check, exposure, region
from acquisition.models import cell_config
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.route import Waypoint
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.runner import jobs
from acquisition.session import FIRST_REFERENCE_NUMBER
from acquisition.waypoints import kinematics
from acquisition.waypoints.reach import ReachMap, reach
from acquisition.waypoints.routing import route
from hardware_sim import nominal
from hardware_sim.world import ExposureInterval, World

CELL = cell_config.load(nominal.default_cell_file())


@dataclass(frozen=True)
class Frames:
    """Frames in memory, by path; implements `measured.FrameSource`."""

    pixels: dict[str, npt.NDArray[np.uint16]] = field(default_factory=dict[str, npt.NDArray[np.uint16]])

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame."""
        return self.pixels[frame.path][start:stop]


@cache
def reached(pixels: int) -> ReachMap:
    """Reach map of the simulated cell's arm."""
    return reach(CELL, nominal.calibration(pixels))


class Session:
    """One session of a recipe in a world."""

    def __init__(self, world: World, recipe: Recipe) -> None:
        self._world, self._recipe = world, recipe
        self._calibration = world.calibration
        self._region = region.keep_out(CELL, world.calibration)
        self._frames = Frames()
        self._shots: list[Shot] = []

    def run(self) -> NormalMap:
        """The session's last normal map."""
        recipe, dome = self._recipe, reached(self._calibration.width)
        if recipe.method != "optimal":
            self._take(0, plan.baseline(recipe.method, recipe.lights_total, recipe, dome))
            return self._solved()
        lights = pilot.pattern(recipe, dome)
        self._take(0, LightPlan(lights=lights, method="pilot", reasons=["pilot"] * len(lights)))
        known = self._solved()
        chosen = plan.choose(
            plan.DesignProblem.of(known, self._observations, recipe, dome, self._calibration), certify=False
        )
        levels = jobs.expected_levels(known, chosen.lights, self._calibration)
        self._take(1, chosen.model_copy(update={"levels_per_s": levels}))
        return self._solved()

    @property
    def _observations(self) -> Observations:
        return Observations.of(self._shots, self._frames)

    def _solved(self) -> NormalMap:
        return normals.solve(
            self._observations,
            self._calibration,
            SolveSettings(),
            normals.ObjectPlace(
                region.middle_depth_m(CELL, self._calibration),
                region=self._region,
                table_depth_m=region.table_depth_m(CELL, self._calibration),
            ),
        )

    def _take(self, number: int, chosen: LightPlan) -> None:
        """The images of a pass in the order of its route, a repetition, then the lamp-off frames, at home."""
        path = route(chosen.lights, CELL.arm.home, CELL, self._calibration)
        shots: dict[int, Shot] = {}
        level = exposure.assumed_level(CELL, self._calibration)
        wanted, camera = self._recipe.exposure, CELL.camera
        for light, waypoint in zip(path.light_numbers, path.waypoints, strict=True):
            key = ShotKey(pass_number=number, number=light)
            exposure_s = exposure.for_level(level, wanted, camera)
            if chosen.levels_per_s is not None:
                exposure_s = exposure.for_predicted_level(chosen.levels_per_s[light], wanted, camera)
            shots[light] = self._lit(key, waypoint, exposure_s)
            level = shots[light].quality.bright_level / shots[light].exposure_s
        if number == 0:
            self._repeat(next(iter(shots.values())), path.waypoints[0])
        darks = [
            self._shot(ShotKey(pass_number=number, number=len(shots) + dark), CELL.arm.home, exposure_s, number)
            for dark, exposure_s in enumerate(sorted({shot.exposure_s for shot in shots.values()}))
        ]
        self._shots += [*shots.values(), *darks]

    def _repeat(self, first: Shot, waypoint: Waypoint) -> None:
        """Repeats the first image at the end of the first pass, whose images have no prediction."""
        key = ShotKey(pass_number=0, number=FIRST_REFERENCE_NUMBER)
        again = self._shot(key, waypoint.joints, first.exposure_s, first.attempt + 1, lit=True)
        self._shots.append(again.model_copy(update={"kind": "reference", "repeats": first.key}))

    def _lit(self, key: ShotKey, waypoint: Waypoint, exposure_s: float) -> Shot:
        wanted, camera, attempt = self._recipe.exposure, CELL.camera, 0
        while True:
            shot = self._shot(key, waypoint.joints, exposure_s, attempt, lit=True)
            pixels = self._frames.pixels[shot.frame.path]
            verdict = check.lit_frame(pixels, self._region, self._calibration.sensor, exposure_s, wanted, camera)
            if verdict.retake_s is None or attempt == self._recipe.retakes:
                assert verdict.usable
                return shot.model_copy(update={"quality": verdict.quality})
            exposure_s, attempt = verdict.retake_s, attempt + 1

    def _shot(
        self, key: ShotKey, joints: tuple[float, ...], exposure_s: float, attempt: int = 0, *, lit: bool = False
    ) -> Shot:
        path = f"{key.pass_number}/{key.number}.tiff"
        self._frames.pixels[path] = self._world.frame([ExposureInterval(1.0, joints, float(lit))], exposure_s, attempt)
        flange = kinematics.forward(kinematics.arm_model(CELL.arm.model), np.array([joints]))[0, -1]
        light = lamp_pose.light_from_tool(flange @ CELL.arm.flange_from_tool.matrix, self._calibration)
        return Shot(
            key=key,
            kind="light" if lit else "dark",
            frame=FrameRef(path=path, width=self._calibration.width, height=self._calibration.height, sha256=""),
            exposure_s=exposure_s,
            light_number=key.number if lit else None,
            light=light if lit else None,
            lamp_on=lit,
            attempt=attempt,
            taken_at=0.0,
            quality=FrameQuality(saturated=0.0, bright_level=0.0, accepted=True),
        )
