"""The solver on simulated images without the arm: interreflections and depth discontinuities."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from acquisition import geometry, lamp_pose
from acquisition.capture import exposure, region
from acquisition.models import cell_config
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals import ObjectPlace, solve
from acquisition.normals.indirect_light import shadow_light
from acquisition.waypoints import kinematics
from acquisition.waypoints.reach import reach
from acquisition.waypoints.routing import route
from hardware_sim import grade, nominal
from hardware_sim.world import ExposureInterval, ProfileName, World

PIXELS = 192
CELL = cell_config.load(nominal.default_cell_file())
CALIBRATION = nominal.calibration(PIXELS)
EXPOSURE_S = 0.03


@dataclass(frozen=True)
class Frames:
    """Frames in memory."""

    pixels: dict[str, npt.NDArray[np.uint16]]

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        return self.pixels[frame.path][start:stop]


@cache
def stations() -> tuple[tuple[float, ...], ...]:
    """Joints of the light nearest the view axis that the arm reaches, and of seven others on a ring at 50°."""
    within = reach(CELL, CALIBRATION)
    units = lamp_pose.directions(within.candidates, within.center, 8)
    top = int(np.argmax(units[:, 2]))
    others = np.delete(np.arange(len(units)), top)
    ring, step = np.arange(7) * 2 * np.pi / 7, 2 * np.pi / 7
    turned = (geometry.direction(np.radians(50), turn + ring) for turn in np.arange(24) * step / 24)
    nearest, _ = lamp_pose.nearest_pattern(turned, units[others])
    lights = [lamp_pose.light_at(within.candidates[index], within.center) for index in (top, *others[nearest])]
    return tuple(waypoint.joints for waypoint in route(lights, CELL.arm.home, CELL, CALIBRATION).waypoints)


@cache
def scene(name: str, profile: ProfileName) -> tuple[World, Observations]:
    world = World(CELL, CALIBRATION, name, 1, profile)
    frames: dict[str, npt.NDArray[np.uint16]] = {}
    model, flange_from_tool = kinematics.arm_model(CELL.arm.model), CELL.arm.flange_from_tool.matrix

    def shot(number: int, joints: tuple[float, ...], lit: bool) -> Shot:
        path = f"{number}.tiff"
        exposure_s = exposure.in_range(EXPOSURE_S, CELL.camera)
        frames[path] = world.frame([ExposureInterval(1.0, joints, float(lit))], exposure_s, 0)
        base_from_tool = kinematics.forward(model, np.array([joints]))[0, -1] @ flange_from_tool
        return Shot(
            key=ShotKey(pass_number=0, number=number),
            kind="light" if lit else "dark",
            frame=FrameRef(path=path, width=PIXELS, height=PIXELS, sha256=""),
            exposure_s=exposure_s,
            light_number=number if lit else None,
            light=lamp_pose.light_from_tool(base_from_tool, CALIBRATION) if lit else None,
            lamp_on=lit,
            taken_at=0.0,
            quality=FrameQuality(saturated=0.0, bright_level=0.5, accepted=True),
        )

    shots = [shot(number, joints, lit=True) for number, joints in enumerate(stations())]
    dark = shot(len(shots), stations()[0], lit=False)
    return world, Observations(shots, {dark.exposure_s: dark}, Frames(frames))


def solved(observations: Observations) -> NormalMap:
    return solve(
        observations,
        CALIBRATION,
        SolveSettings(),
        ObjectPlace(
            region.middle_depth_m(CELL, CALIBRATION),
            region=region.keep_out(CELL, CALIBRATION),
            table_depth_m=region.table_depth_m(CELL, CALIBRATION),
        ),
    )


def graded(normal_map: NormalMap, world: World) -> grade.Grade:
    return grade.grade(normal_map.normals, normal_map.mask, normal_map.sigma_deg, world.truth(), CALIBRATION)


@pytest.mark.long
@pytest.mark.parametrize("name", ["part", "figure"])
def test_interreflection_correction_improves_normals(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world, observations = scene(name, "realistic")
    corrected = solved(observations)
    assert corrected.notes["interreflection"]["share"] > 0.01
    with monkeypatch.context() as patched:
        patched.setattr(shadow_light, "shadows_show_indirect", lambda *_: False)
        uncorrected = solved(observations)
    assert graded(corrected, world).mean_deg < 0.85 * graded(uncorrected, world).mean_deg


@pytest.mark.long
def test_interreflection_convex_object_is_hardly_corrected() -> None:
    world, observations = scene("figure", "direct")
    normal_map = solved(observations)
    assert normal_map.notes["interreflection"]["share"] == 0
    assert graded(normal_map, world).mean_deg < 1.5


def test_depth_machined_part_keeps_its_discontinuities() -> None:
    """Smooth integration closes most of them, because the camera sees no wall."""
    world, observations = scene("part", "direct")
    normal_map, true = solved(observations), world.truth()
    both = normal_map.mask & true.mask
    error = normal_map.depth[both] - true.depth[both]
    spread = float(np.std(true.depth[both]))
    assert float(np.median(np.abs(error - np.median(error)))) < 0.35 * spread


def test_table_depth_agrees_with_the_cell() -> None:
    depth = region.table_depth_m(CELL, CALIBRATION)
    assert depth.shape == (PIXELS, PIXELS)
    assert depth[PIXELS // 2, PIXELS // 2] == pytest.approx(0.9, abs=1e-6)  # the camera looks straight down on it
    assert np.ptp(depth) < 1e-6
