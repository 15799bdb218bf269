"""Light patterns of the bench, per azimuth: the planner's, the planner's from the truth as pilot, and fixed ones.

Every pattern is turned by a share of its own period for each azimuth, so that the mean over azimuths does not depend on
the object's orientation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import geometry, photometry, pilot, plan
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.result import LIT, FisherInformation, NormalMap
from acquisition.models.route import Refusal
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.plan import baselines, sample_pixels, visibility
from acquisition.plan.planned_images import PlannedImages
from tests.unseen.captures import Capture
from tests.unseen.scenes import Scene

FIXED = ("two-rings", "ring-35", "drbohlav", "random")
PLANNED = ("planned", "oracle")
PATTERNS = (*FIXED, *PLANNED)
CANDIDATES = 300
SLANT_DEG = (8.0, 75.0)
PILOT_LIGHTS = 4
LIT_SHARE = 0.08
"""Share of a pixel's brightest value above which the oracle takes the pixel as lit."""
ORACLE_PIXELS = 1500
ORACLE_SIGMA_DEG = 0.5


class Dome:
    """A reach without an arm: candidates cover the dome, turned by `turn` about the view axis."""

    def __init__(self, scene: Scene, turn: float = 0.0) -> None:
        cosine = np.linspace(*np.cos(np.radians(SLANT_DEG)), CANDIDATES)
        units = geometry.direction(np.arccos(cosine), turn + np.arange(CANDIDATES) * np.pi * (3 - np.sqrt(5)))
        self.radius_m, self.center = scene.radius_m, scene.center
        self.candidates = self.center + self.radius_m * units

    def allows(self, position: np.ndarray) -> Refusal | None:
        """None between the lowest and the highest lights."""
        unit = (np.asarray(position) - self.center) / np.linalg.norm(np.asarray(position) - self.center)
        low, high = np.cos(np.radians([SLANT_DEG[1] + 1, SLANT_DEG[0] - 1]))
        if low <= unit[2] <= high:
            return None
        return Refusal(reason="too-far", detail="not on the dome")


@dataclass(frozen=True)
class Planned:
    """A planner's lights (F, 3) and its forecast of the mean σ."""

    positions: np.ndarray
    predicted_sigma_deg: float


def fixed(name: str, scene: Scene, count: int, azimuth: int, azimuths: int) -> np.ndarray:
    """Positions (count, 3) of a fixed pattern at one of `azimuths` azimuths."""
    turn = azimuth / azimuths
    if name == "random":
        reach = Dome(scene)
        lights = plan.baseline("random", count, Recipe(seed=scene.seed * 100 + azimuth), reach).lights
        return places(lights)
    if name == "two-rings":
        units = baselines.two_rings(count, turn)
    else:
        slant = {"ring-35": 35.0, "drbohlav": baselines.DRBOHLAV_SLANT_DEG}[name]
        units = geometry.direction(np.radians(slant), (turn + np.arange(count)) * 2 * np.pi / count)
    return scene.center + scene.radius_m * units


def pilot_lights(scene: Scene, azimuth: int, azimuths: int) -> np.ndarray:
    """Positions of the recipe's pilot, turned by a share of its ring's step."""
    step = 2 * np.pi / (PILOT_LIGHTS - 1)
    return places(pilot.pattern(Recipe(pilot_lights=PILOT_LIGHTS), Dome(scene, step * azimuth / azimuths)))


def planned(scene: Scene, solved: NormalMap, first: Capture, count: int, azimuth: int) -> Planned:
    """The product's plan of `count` lights in all, pilot included, from the pilot's capture."""
    problem = plan.DesignProblem.of(solved, observations(first), Recipe(seed=azimuth), Dome(scene), first.calibration)
    chosen = plan.choose(problem, count - len(first.stack.lights), certify=False)
    return Planned(places(chosen.lights), chosen.predicted_sigma_deg or float("nan"))


def observations(first: Capture) -> Observations:
    """A pilot's images in the form that the planner reads."""
    shots = [_shot(light, number, first.seconds[number]) for number, light in enumerate(first.stack.lights)]
    return Observations(shots=shots, darks={}, frames=_NoFrames())


def oracle(scene: Scene, solved: NormalMap, first: Capture) -> NormalMap:
    """The pilot's normal map with true normals, albedo, depth and shadows in place of the solved ones."""
    true = scene.truth
    rows, columns = np.nonzero(true.within_78_deg)
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), ORACLE_PIXELS)).astype(int)
    rows, columns = rows[chosen].astype(np.int64), columns[chosen].astype(np.int64)
    values = first.stack.whole.values
    lit = values > LIT_SHARE * values.max(axis=0)
    blank = replace(
        solved,
        normals=true.normals,
        albedo=true.albedo,
        depth=true.depth_m,
        mask=true.object,
        silhouette=true.object,
        sigma_deg=np.where(true.object, ORACLE_SIGMA_DEG, np.nan).astype(np.float32),
        flags=np.where(lit & true.object, LIT, 0).astype(np.uint8),
        doubtful=None,
        information=FisherInformation(rows, columns, np.zeros((len(rows), 4, 4))),
    )
    known, lights = first.calibration, list(first.stack.lights)
    samples = replace(sample_pixels.samples(blank, known, np.arange(len(rows))), margin=np.zeros(len(rows)))
    design = PlannedImages(visibility.surface(blank, known), known, Exposure()).candidates(samples, lights)
    row = design.row.astype(float) * lit[:, rows, columns][:, None]
    row[:, 3] /= photometry.SETTINGS.depth_sigma_m
    information = np.einsum("kap,kbp->pab", row, row)
    return replace(blank, information=FisherInformation(rows, columns, information))


def places(lights: Sequence[Light]) -> np.ndarray:
    """Positions (F, 3) of lights."""
    return np.array([light.position for light in lights])


class _NoFrames:
    """Frames that cannot be read, because the planner needs none."""

    def rows(self, frame: FrameRef, start: int, stop: int) -> np.ndarray:
        raise LookupError(frame.path)


def _shot(light: Light, number: int, seconds: float) -> Shot:
    return Shot(
        key=ShotKey(pass_number=0, number=number),
        kind="light",
        frame=FrameRef(path=f"{number}.tiff", width=1, height=1, sha256=""),
        exposure_s=float(seconds),
        light=light,
        taken_at=0.0,
        quality=FrameQuality(saturated=0.0, bright_level=0.8, accepted=True),
    )
