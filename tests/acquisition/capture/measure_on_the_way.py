"""Time and error of a session whose images are taken on the way against one that takes them at rest, in simulated time.

`python -m tests.acquisition.capture.measure_on_the_way --objects sphere vase --seeds 1 2 3 [--lights 32] [--pixels 96]`

Both sessions have the same lights, object and draws, and each the route that the runner would plan. Moves are the
controller's trapezoids; the arm's poses arrive at 125 Hz with a jitter; begin and end of each exposure, its pose and
its verdict come from `acquisition.capture.moving` and `check`, and each frame is the simulated world's under the lamp's
true motion. Nothing waits for a clock, so that the machine's load does not matter. A session's time is from its first
move until the arm is home again with the lamp-off frames taken, the closing repetition of the first image included;
planning and solving are not.
"""

import argparse
import json
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from acquisition.capture import check, exposure, moving, region
from acquisition.devices import TrackPoint
from acquisition.models import cell_config
from acquisition.models.base import as_joints, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.result import SolveSettings
from acquisition.models.route import Route
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey, ShotMotion
from acquisition.runner import jobs
from acquisition.runner.moving_shots import AFTER_S
from acquisition.runner.session_solve import solve_in_cell
from acquisition.waypoints import measured_pose, routing
from hardware_sim import grade, nominal
from hardware_sim.controller.profile import Trapezoid
from hardware_sim.world import ExposureInterval, World

DATA_S = 0.008
"""Period of the controller's data, s."""
DELAY_S = (0.001, 0.007)
"""Least and largest delay of a pose until it is here, s."""
LEAD_S = (0.002, 0.006)
"""Least and largest time from a call of the camera until its exposure begins, s."""
STATED_S = 0.002
"""1 σ of what a driver states as an exposure's middle, s."""
REST_S = 0.040
"""Five samples at rest end a move, s."""
COMMAND_S = 0.016
"""A command to the arm's driver and the first data that show it, s: a move's begin, a lamp's level."""
READ_OUT_S = 0.020
"""Transfer of a frame of one megapixel over GigE, s."""
INTERVALS = 6


@dataclass
class Frames:
    """Frames in memory."""

    stored: dict[str, npt.NDArray[np.uint16]] = field(default_factory=dict[str, npt.NDArray[np.uint16]])

    def add(self, name: str, pixels: npt.NDArray[np.uint16]) -> FrameRef:
        self.stored[name] = pixels
        return FrameRef(path=name, width=pixels.shape[1], height=pixels.shape[0], sha256="0")

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        return self.stored[frame.path][start:stop]


def host_s() -> float:
    """Processor time, s, of judging a frame of one megapixel: what the load of this machine does not change."""
    calibration = nominal.calibration(1024)
    pixels = np.random.default_rng(1).integers(100, 3000, (1024, 1024)).astype(np.uint16)
    inside = np.ones(pixels.shape, bool)
    camera = cell_config.load(nominal.default_cell_file()).camera
    times: list[float] = []
    for _ in range(3):
        begun = time.process_time()
        verdict = check.lit_frame(pixels, inside, calibration.sensor, 0.05, Exposure(), camera)
        check.compare_with_earlier(verdict.quality, pixels, inside, calibration.sensor, 0.05, [0.5], None)
        times.append(time.process_time() - begun)
    return min(times)


@dataclass
class Session:
    """A simulated session of one route."""

    cell: CellConfig
    calibration: Calibration
    world: World
    route: Route
    random: np.random.Generator
    host_s: float
    clock: float = 0.0
    frames: Frames = field(default_factory=Frames)
    shots: list[Shot] = field(default_factory=list[Shot])
    retaken: int = 0
    level: float | None = None

    def run(self, *, on_the_way: bool) -> tuple[float, Observations]:
        """The session's time, s, and its images."""
        here = self.route.start
        missed: list[int] = []
        for place, waypoint in enumerate(self.route.waypoints):
            if on_the_way and self.level is not None:
                if not self._pass(place, here):
                    missed.append(place)
            else:
                self._travel(here, place)
                self._stand(place)
            here = waypoint.joints
        for place in missed:  # about as far as from light to light
            self.clock += self.route.seconds / len(self.route.waypoints)
            self._stand(place)
            self.retaken += 1
        first = self.route.waypoints[0]
        self.clock += first.seconds + self._standing_s(self.shots[0].exposure_s)
        self.clock += self.route.seconds - sum(waypoint.seconds for waypoint in self.route.waypoints)
        darks = {shot.exposure_s: self._dark(shot.exposure_s) for shot in self.shots}
        self.clock += REST_S + self.cell.arm.settle_s + sum(seconds + READ_OUT_S + self.host_s for seconds in darks)
        return self.clock, Observations(self.shots, darks, self.frames)

    def _exposure_s(self) -> float:
        level = exposure.assumed_level(self.cell, self.calibration) if self.level is None else self.level
        return exposure.for_level(level, Exposure(), self.cell.camera)

    def _travel(self, here: tuple[float, ...], place: int) -> None:
        self.clock += COMMAND_S + self.route.waypoints[place].seconds + REST_S

    def _standing_s(self, exposure_s: float) -> float:
        """An image at rest: settling, lamp on and off, exposure, readout, judging."""
        return float(
            self.cell.arm.settle_s + 2 * COMMAND_S + self.cell.lamp.rise_s + exposure_s + np.mean(LEAD_S) + READ_OUT_S
            + self.host_s
        )  # fmt: skip

    def _stand(self, place: int) -> None:
        joints, exposure_s = self.route.waypoints[place].joints, self._exposure_s()
        for attempt in range(3):
            self.clock += self._standing_s(exposure_s)
            frame = self.world.frame([ExposureInterval(1.0, joints, 1.0)], exposure_s, attempt)
            verdict = self._judge(frame, exposure_s)
            if verdict.retake_s is None or attempt == 2:
                self._keep(place, frame, exposure_s, verdict.quality, (joints, self._pose(joints), None))
                return
            exposure_s = verdict.retake_s

    def _pass(self, place: int, here: tuple[float, ...]) -> bool:
        """An image on the way; whether it was good."""
        waypoint, exposure_s = self.route.waypoints[place], self._exposure_s()
        corners = np.array([here, *waypoint.path])
        moves = [
            Trapezoid.planned(
                float(np.max(np.abs(b - a))), speed, self.cell.arm.max_joint_acceleration_rad_s2, 0.0, 10.0, 100.0
            )
            for a, b, speed in zip(corners[:-1], corners[1:], waypoint.speeds, strict=True)
        ]  # fmt: skip
        arrival = sum(move.duration for move in moves)
        after = self.route.waypoints[place + 1] if place + 1 < len(self.route.waypoints) else None
        leaving = [] if after is None else [np.array(waypoint.joints), np.array(after.path[0])]
        leaves = np.inf

        def joints_at(t: float) -> npt.NDArray[np.float64]:
            if t > leaves and leaving:
                onward = Trapezoid.planned(
                    float(np.max(np.abs(leaving[1] - leaving[0]))), after.speeds[0] if after else 1.0,
                    self.cell.arm.max_joint_acceleration_rad_s2, 0.0, 10.0, 100.0,
                )  # fmt: skip
                return leaving[0] + onward.position(t - leaves) / onward.length * (leaving[1] - leaving[0])
            for move, a, b in zip(moves, corners[:-1], corners[1:], strict=True):
                if t <= move.duration:
                    return a + (move.position(t) / move.length if move.length else 1.0) * (b - a)
                t -= move.duration
            return corners[-1]

        phase = self.random.uniform(0, DATA_S)
        points: list[TrackPoint] = []

        def receive(until: float) -> moving.LampTrack:
            while (stamp := phase + DATA_S * len(points) - 0.1) <= until:
                joints = joints_at(max(stamp, 0.0))
                arrives = stamp + self.random.uniform(*DELAY_S)
                points.append(TrackPoint(100 + stamp, arrives, tuple(joints.tolist()), self._pose(joints)))
            here_now = [point for point in points if point.received_at <= until]
            return moving.lamp_track(here_now[-80:], np.array(self.calibration.tool_from_lamp))

        allowed_m = moving.AIMED_SHARE * self.calibration.lamp_position_sigma_m
        t = max(0.0, arrival - 0.5)
        while not moving.is_near(receive(t), waypoint.joints, allowed_m, LEAD_S[1]):
            t += 0.002
        begins = t + self.random.uniform(*LEAD_S)
        leaves = max(arrival + REST_S, t + LEAD_S[1] + exposure_s + AFTER_S) + COMMAND_S
        times = begins + exposure_s * (np.arange(INTERVALS) + 0.5) / INTERVALS
        intervals = [ExposureInterval(1 / INTERVALS, tuple(joints_at(float(at)).tolist()), 1.0) for at in times]
        frame = self.world.frame(intervals, exposure_s, 0)
        self.clock += leaves  # the next move begins then; its command is part of it
        stated = begins + exposure_s / 2 + STATED_S * self.random.normal()
        middle = moving.during(receive(begins + exposure_s + 0.1), stated - exposure_s / 2, stated + exposure_s / 2)
        if middle is None or middle.motion.moved_m > moving.MAX_SHARE * self.calibration.lamp_position_sigma_m:
            return False
        verdict = self._judge(frame, exposure_s)
        if verdict.retake_s is not None:
            return False
        self._keep(place, frame, exposure_s, verdict.quality, (middle.joints, middle.base_from_tool, middle.motion))
        return True

    def _judge(self, frame: npt.NDArray[np.uint16], exposure_s: float) -> check.Verdict:
        inside = region.keep_out(self.cell, self.calibration)
        return check.lit_frame(frame, inside, self.calibration.sensor, exposure_s, Exposure(), self.cell.camera)

    def _pose(self, joints: tuple[float, ...] | npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return self.world.base_from_flange(tuple(np.array(joints).tolist())) @ self.cell.arm.flange_from_tool.matrix

    def _keep(
        self, place: int, frame: npt.NDArray[np.uint16], exposure_s: float, quality: FrameQuality,
        where: tuple[tuple[float, ...], npt.NDArray[np.float64], ShotMotion | None],
    ) -> None:  # fmt: skip
        joints, pose, motion = where
        light = measured_pose.light(pose, np.array(joints), self.cell.arm, self.calibration)
        self.level = quality.bright_level / exposure_s
        self.shots.append(
            Shot(
                key=ShotKey(pass_number=0, number=place), kind="light", frame=self.frames.add(f"{place}", frame),
                exposure_s=exposure_s, light_number=place, light=light, joints=as_joints(joints),
                base_from_tool=as_matrix4(pose), lamp_on=True, taken_at=float(place), quality=quality, motion=motion,
            )
        )  # fmt: skip

    def _dark(self, exposure_s: float) -> Shot:
        frame = self.world.frame([ExposureInterval(1.0, self.cell.arm.home, 0.0)], exposure_s, 0)
        return Shot(
            key=ShotKey(pass_number=0, number=1000), kind="dark", frame=self.frames.add(f"dark{exposure_s}", frame),
            exposure_s=exposure_s, taken_at=0.0,
            quality=FrameQuality(saturated=0.0, bright_level=0.0, accepted=True),
        )  # fmt: skip


def compare(
    routes: tuple[Route, Route], shown: str, seed: int, pixels: int, judging_s: float
) -> dict[str, float | int | str]:
    """Times, s, mean errors, deg, and ratio of errors to their own σ, at rest and on the way."""
    cell, calibration = cell_config.load(nominal.default_cell_file()), nominal.calibration(pixels)
    world = World(cell, calibration, shown, seed, "realistic")
    row: dict[str, float | int | str] = {"object": shown, "seed": seed}
    for name, route, on_the_way in (("rest", routes[0], False), ("way", routes[1], True)):
        session = Session(cell, calibration, world, route, np.random.default_rng(seed), judging_s)
        seconds, observations = session.run(on_the_way=on_the_way)
        result = solve_in_cell(observations, cell, calibration, SolveSettings())
        graded = grade.grade(result.normals, result.mask, result.sigma_deg, world.truth(), calibration)
        row |= {f"{name}_s": round(seconds, 2), f"{name}_deg": round(graded.mean_deg, 4)}
        row |= {f"{name}_found_to_predicted": round(graded.found_to_predicted or 0.0, 3)}
        moved = [shot.motion.moved_m for shot in session.shots if shot.motion is not None]
        if on_the_way:
            row |= {"retaken": session.retaken, "moved_mm": round(1e3 * float(np.mean(moved)), 3)}
    return row


def main() -> None:
    """Prints a line of JSON for each object and seed, then the means with their standard errors."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--objects", nargs="+", default=["sphere", "vase"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--lights", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=96)
    parser.add_argument("--cache", type=Path, default=Path("/tmp/lightpose-on-the-way.json"))  # noqa: S108
    given = parser.parse_args()
    cell, calibration = cell_config.load(nominal.default_cell_file()), nominal.calibration(given.pixels)
    recipe = Recipe(method="two-rings", pilot_lights=min(given.lights, 16), planned_lights=max(0, given.lights - 16))
    lights = jobs.first_lights(recipe, cell, calibration, given.cache).lights
    route, judging_s = routing.route(lights, cell.arm.home, cell, calibration), host_s()
    on_the_way = routing.route(lights, cell.arm.home, cell, calibration, routing.DENSE_NODES)
    rows = []
    for shown in given.objects:
        for seed in given.seeds:
            rows.append(compare((route, on_the_way), shown, seed, given.pixels, judging_s))
            print(json.dumps(rows[-1]), flush=True)
    for name in ("s", "deg", "found_to_predicted"):
        ratios = np.array([row[f"way_{name}"] / row[f"rest_{name}"] for row in rows])
        error = np.std(ratios, ddof=1) / np.sqrt(len(ratios)) if len(ratios) > 1 else np.nan
        print(f"{name}: on the way over at rest {ratios.mean():.4f} ± {error:.4f} (n = {len(ratios)})")
    print(f"moves {route.seconds:.1f} and {on_the_way.seconds:.1f} s, judging {judging_s:.3f} s")


if __name__ == "__main__":
    main()
