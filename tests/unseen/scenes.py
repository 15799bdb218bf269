"""Scenes drawn from a family and a seed: object, camera, dome of lamps, lobe, sensor; their truth and their images.

Seeds below 1000 are design seeds, on which numbers may be tuned. Seeds from 1000 on are report seeds, which are refused
unless the bench runs with `--report`: results that have been looked at no longer measure what holds on unseen shapes.

Images are cached under build/unseen (or $LIGHTPOSE_UNSEEN_CACHE) by the hash of all that they depend on.
"""

import functools
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from acquisition.models.calibration import Calibration, SensorModel
from hardware_sim import families
from hardware_sim.reflectance import Reflectance
from hardware_sim.sheets import Mesh
from tests.unseen import brdf, tracer
from tests.unseen.tracer import Lamp, Texture, Tracer

CACHE = Path(os.environ.get("LIGHTPOSE_UNSEEN_CACHE", Path(__file__).parents[2] / "build" / "unseen"))
VERSION = 2
"""Must be raised when a change in this file changes the rendered images."""

PIXELS = 144
REPORT_SEEDS_FROM = 1000
FOCAL_WIDTHS = (2.0, 5.0)
DISTANCE_M = (0.3, 0.9)
FILL = (0.7, 0.9)
DOME_M = (0.3, 0.5)
HALF_ANGLE_DEG = (20.0, 60.0)
"""Range of the angle off the axis at which the lamps' intensity is half."""
NOISE = (0.003, 0.03)
"""Range of a pixel's noise at the exposure's target, as a share of the signal."""
READ_SHARE = 0.1
"""Ratio of the read noise to the shot noise of a full well."""
TARGET = 0.8
"""Share of full scale at which the exposure puts the 99.5th percentile of the object."""
INTENSITY_SIGMA, POSITION_SIGMA_M = 0.01, 0.001
ROUGH_DEPTH_M = 0.01
"""Greatest error, m, of the solver's initial depth."""
GRADED_DEG, CREASE_DEG, TENTH = 78.0, 20.0, 0.1
SURFACE_DEG = 45.0
"""Greatest angle between the normals at a pixel's middle and at another of its points on the same surface."""
GRADINGS = ("one_surface", "within_78_deg", "object")

_report_seeds_allowed = False


@contextmanager
def report_seeds() -> Iterator[None]:
    """Lets `scene` draw report seeds; only for the bench's `--report`."""
    global _report_seeds_allowed  # noqa: PLW0603 - a guard against looking by mistake, for one process
    _report_seeds_allowed = True
    try:
        yield
    finally:
        _report_seeds_allowed = False


@dataclass(frozen=True)
class Truth:
    """Ground truth of each pixel of an (H, W) image: normals (H, W, 3), view frame; depth (H, W) along OpenCV's z; and
    the pixels of the three gradings.

    `object`: all pixels that show it. `within_78_deg`: those whose normal is within 78° of the viewing ray, eroded by
    one pixel. `one_surface`: of these, pixels without steep surroundings that straddle no crease of 20°.
    """

    normals: np.ndarray
    depth_m: np.ndarray
    albedo: np.ndarray
    object: np.ndarray
    within_78_deg: np.ndarray
    one_surface: np.ndarray

    def error_deg(self, normals: np.ndarray) -> np.ndarray:
        """Angle (H, W) to the true normal."""
        cross = np.linalg.norm(np.cross(normals, self.normals), axis=-1)
        return np.degrees(np.arctan2(cross, np.sum(normals * self.normals, axis=-1)))


@dataclass(frozen=True, eq=False)
class Scene:
    """One draw: the object in the view frame and everything that forms its images."""

    family: str
    seed: int
    reflectance: Reflectance
    mesh: Mesh
    texture: Texture
    pixels: int
    focal_px: float
    center: np.ndarray  # (3,) m, view frame: middle of the object and of the dome
    radius_m: float
    lobe: tuple[float, float]
    sensor: SensorModel
    rough_depth_m: float

    @functools.cached_property
    def key(self) -> str:
        """Hash of everything except the lamps' positions on which images depend."""
        key = hashlib.sha256(np.ascontiguousarray(self.mesh.triangles).tobytes())
        key.update(np.ascontiguousarray(self.mesh.corner_normals).tobytes())
        key.update(np.asarray(self.texture(self.mesh.triangles[::7].mean(axis=1))).tobytes())
        camera = (self.pixels, self.focal_px, self.center.tolist(), self.radius_m, self.lobe)
        key.update(
            repr(
                (VERSION, tracer.VERSION[self.reflectance.kind], self.reflectance, self.reflectance.scatter_m, camera)
            ).encode()
        )
        return key.hexdigest()[:20]

    @property
    def lobe_exponent(self) -> float:
        """Exponent of cosᵘ that fits the lobe best over the object, as a calibration would state it."""
        widest = np.arcsin(np.max(np.linalg.norm(self.mesh.triangles - self.center, axis=-1)) / self.radius_m)
        angle = np.linspace(1e-3, widest, 200)
        cosine = np.log(np.cos(angle))
        falls = np.log([brdf.falloff(np.array(self.lobe), c) for c in np.cos(angle)])
        return float(np.sum(angle * falls * cosine) / np.sum(angle * cosine**2))

    @property
    def calibration(self) -> Calibration:
        """The solver's calibration: the exact camera, the best exponent, 1 % and 1 mm."""
        middle = (self.pixels - 1) / 2
        return Calibration(
            width=self.pixels,
            height=self.pixels,
            camera_matrix=((self.focal_px, 0.0, middle), (0.0, self.focal_px, middle), (0.0, 0.0, 1.0)),
            distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
            base_from_camera=((1.0, 0, 0, 0), (0.0, -1, 0, 0), (0.0, 0, -1, 1.0), (0.0, 0, 0, 1)),
            tool_from_lamp=((1.0, 0, 0, 0), (0.0, 1, 0, 0), (0.0, 0, 1, 0), (0.0, 0, 0, 1)),
            lamp_intensity=1.0,
            reference_m=self.radius_m,
            lobe_exponent=self.lobe_exponent,
            sensor=self.sensor,
            intensity_sigma=INTENSITY_SIGMA,
            lamp_position_sigma_m=POSITION_SIGMA_M,
            made_at="2026-01-01T00:00:00Z",
            valid_days=100.0,
        )

    def axes(self, positions: np.ndarray) -> np.ndarray:
        """Axes (F, 3) of lamps at positions (F, 3): towards the object's middle."""
        axis = self.center - positions
        return axis / np.linalg.norm(axis, axis=1, keepdims=True)

    def images(self, positions: np.ndarray) -> np.ndarray:
        """Noise-free values y (F, H, W) float32 under lamps at (F, 3), m, view frame; cached."""
        out = np.empty((len(positions), self.pixels, self.pixels), np.float32)
        for number, (position, axis) in enumerate(zip(positions, self.axes(positions), strict=True)):
            place = np.round(position, 7) + 0.0
            path = self._folder / f"{hashlib.sha256(place.tobytes()).hexdigest()[:20]}.npy"
            if path.exists():
                out[number] = np.load(path)
            else:
                out[number] = self._tracer.render(Lamp(place, axis, self.lobe))
                _keep(path, out[number])
        return out

    def ambient(self) -> np.ndarray:
        """Values y (H, W) under light of radiance 1 from all round."""
        path = self._folder / "ambient.npy"
        if not path.exists():
            _keep(path, self._tracer.ambient().astype(np.float32))
        return np.load(path)

    @functools.cached_property
    def truth(self) -> Truth:
        """Ground truth at the pixels' centres."""
        path = self._folder / "truth.npy"
        if not path.exists():
            _keep(path, _truth(self))
        kept = np.load(path)
        masks = (part > 0 for part in np.moveaxis(kept[..., 5:], -1, 0))
        return Truth(kept[..., :3], kept[..., 3], kept[..., 4], *masks)

    @functools.cached_property
    def _tracer(self) -> Tracer:
        return Tracer(
            self.mesh, self.texture, brdf.of(self.reflectance), pixels=self.pixels, focal_px=self.focal_px,
            scatter_m=self.reflectance.scatter_m, reference_m=self.radius_m,
        )  # fmt: skip

    @property
    def _folder(self) -> Path:
        return CACHE / f"{self.family}-{self.seed}-{self.key}"


def _keep(path: Path, values: np.ndarray) -> None:
    """Writes an array atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}")
    with part.open("wb") as file:
        np.save(file, values)
    part.rename(path)


@functools.lru_cache(maxsize=2)
def scene(family: str, seed: int, reflectance: str | None = None, pixels: int = PIXELS) -> Scene:
    """Draws the scene of a family and a seed; `reflectance`, by name, replaces the object's own.

    Raises ValueError for a report seed outside `report_seeds`.
    """
    if seed >= REPORT_SEEDS_FROM and not _report_seeds_allowed:
        raise ValueError(f"seed {seed} is for the report: use seeds below {REPORT_SEEDS_FROM}, or the bench's --report")
    made = _made(family, seed)
    material = made.reflectance if reflectance is None else Reflectance.parse(reflectance)
    rng = np.random.default_rng([families.NAMES.index(family), seed, 17])
    corners = made.mesh.triangles.reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    focal, distance = _camera(corners - middle, rng)
    shift = np.array([0.0, 0.0, -distance]) - middle
    half = np.radians(rng.uniform(*HALF_ANGLE_DEG))
    lobe = (float(half), float(rng.uniform(0, 1)))
    return Scene(
        family=family,
        seed=seed,
        reflectance=material,
        mesh=made.mesh.transformed(np.eye(3), shift),
        texture=lambda points: made.texture(points - shift),
        pixels=pixels,
        focal_px=focal * pixels,
        center=np.array([0.0, 0.0, -distance]),
        radius_m=float(rng.uniform(*DOME_M)),
        lobe=lobe,
        sensor=_sensor(float(np.exp(rng.uniform(*np.log(NOISE))))),
        rough_depth_m=distance + float(rng.uniform(-ROUGH_DEPTH_M, ROUGH_DEPTH_M)),
    )


_made = functools.lru_cache(maxsize=1)(families.make)
"""Makes an object and keeps the last one, because making takes up to 3 s, whatever its reflectance and images."""


def _camera(corners: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Focal length in image widths and distance of the object's middle, so that its corners (N, 3) fill the frame."""
    fill, focal = rng.uniform(*FILL), float(np.exp(rng.uniform(*np.log(FOCAL_WIDTHS))))

    def distance(focal: float) -> float:
        # The least z with every corner inside the frame: |x| / (z − corner's z) ≤ fill / 2 / focal.
        return float(np.max(np.abs(corners[:, :2]).max(axis=1) * 2 * focal / fill + corners[:, 2]))

    far, near = distance(focal), DISTANCE_M[0]
    if far < near:
        focal = min(FOCAL_WIDTHS[1], focal * near / far)
    elif far > DISTANCE_M[1]:
        focal = focal * DISTANCE_M[1] / far
    return focal, float(np.clip(distance(focal), *DISTANCE_M))


def _sensor(noise: float) -> SensorModel:
    """A 12-bit sensor whose shot noise at the exposure's target is `noise`."""
    well = 1 / (TARGET * noise**2)
    return SensorModel(
        bits=12, gain_e_per_dn=well / 4095, read_noise_e=READ_SHARE * well**0.5, full_well_e=well, black_level_dn=0.0
    )


def _truth(one: Scene) -> np.ndarray:
    """Truth as (H, W, 8): normals, depth, albedo, and the three gradings from the widest to the narrowest.

    A pixel's normal and albedo are means over its middle and those of its 16 points that face within SURFACE_DEG of it.
    On a Lambertian surface they determine the pixel's mean light; the middle's own values have aliasing in addition.
    """
    surface, side = tracer.Surface(one.mesh, one.texture), one.pixels
    center, fine = (tracer.camera_rays(side, one.focal_px, samples) for samples in (1, 4))
    out = np.zeros((side**2, 8), np.float32)
    middle, _ = surface.hits(np.zeros_like(center), center)
    seen = middle.ray
    out[seen, 3], out[seen, 5] = -middle.point[:, 2], 1

    hits, _ = surface.hits(np.zeros_like(fine), fine)
    limit = np.cos(np.radians(GRADED_DEG))
    steep = np.ones(len(fine), bool)
    steep[hits.ray] = -np.sum(hits.normal * _unit(fine[hits.ray]), axis=1) < limit
    points = np.zeros((len(fine), 4))
    points[hits.ray] = np.concatenate([hits.normal, hits.albedo[:, None]], axis=1)
    points = points.reshape(-1, 16, 4)[seen]
    facing = np.sum(points[..., :3] * middle.normal[:, None], axis=-1)
    same = np.where((facing > np.cos(np.radians(SURFACE_DEG)))[..., None], points, 0.0)
    same = np.concatenate([same, np.concatenate([middle.normal, middle.albedo[:, None]], axis=1)[:, None]], axis=1)
    normal = _unit(same[..., :3].sum(axis=1))
    out[seen, :3] = normal
    out[seen, 4] = same[..., 3].sum(axis=1) / np.count_nonzero(same[..., 3], axis=1)

    slanted = np.zeros(side**2, bool)
    slanted[seen] = -np.sum(normal * _unit(center[seen]), axis=1) >= limit
    out[:, 6] = _eroded(slanted.reshape(side, side)).ravel()
    plain = np.zeros(side**2, bool)
    # A crease runs through the pixel if a share of it, neither small nor almost all, faces another way.
    other = np.mean(facing < np.cos(np.radians(CREASE_DEG)), axis=1)
    plain[seen] = np.minimum(other, 1 - other) < TENTH
    mostly = np.mean(steep.reshape(-1, 16), axis=1) < TENTH
    out[:, 7] = _eroded(mostly.reshape(side, side)).ravel() & plain & (out[:, 6] > 0)
    return out.reshape(side, side, 8)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _eroded(mask: np.ndarray) -> np.ndarray:
    """The mask eroded by one pixel; everything beyond the frame counts as outside."""
    return cv2.erode(np.pad(mask, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
