"""Small scenes of known truth: height fields over a table, seen in perspective, lit by a near lamp.

Independent of the solver in how they are made: every pixel's ray is marched to the surface, every shadow is marched
through the height function itself, the light's law is written out again, and the sensor counts electrons.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from acquisition import geometry
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.light_plan import Light  # fmt: skip
from acquisition.models.route import Refusal
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals import Images

TABLE_DEPTH = 0.9
Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def calibration(size: int = 192, **changes: object) -> Calibration:
    """A camera 0.9 m above the table that sees 0.2 m of it."""
    focal = size * TABLE_DEPTH / 0.2
    values = {
        "width": size,
        "height": size,
        "camera_matrix": ((focal, 0.0, size / 2 - 0.5), (0.0, focal, size / 2 - 0.5), (0.0, 0.0, 1.0)),
        "distortion": (0.0, 0.0, 0.0, 0.0, 0.0),
        "base_from_camera": ((1.0, 0, 0, 0), (0.0, -1, 0, 0), (0.0, 0, -1, TABLE_DEPTH), (0.0, 0, 0, 1)),
        "tool_from_lamp": ((1.0, 0, 0, 0), (0.0, 1, 0, 0), (0.0, 0, 1, 0), (0.0, 0, 0, 1)),
        "lamp_intensity": 20.0,
        "reference_m": 0.45,
        "lobe_exponent": 0.8,
        "sensor": SensorModel(bits=12, gain_e_per_dn=2.5, read_noise_e=5.0, full_well_e=10077.5, black_level_dn=64.0),
        "intensity_sigma": 0.01,
        "lamp_position_sigma_m": 0.001,
        "made_at": "2026-01-01T00:00:00Z",
        "valid_days": 100.0,
    }
    values.update(changes)
    return Calibration(**values)


def sphere(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Upper half of a ball of 50 mm radius on the table."""
    inside = 0.05**2 - x**2 - y**2
    return np.where(inside > 0, 0.05 + np.sqrt(np.maximum(inside, 0)), 0.0)


def bumps(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A round cushion with waves on it."""
    r2 = (x**2 + y**2) / 0.055**2
    inside = r2 < 1
    top = 0.03 * (1 - r2[inside]) + 0.005 * np.sin(x[inside] / 0.008) * np.cos(y[inside] / 0.01) + 0.012
    heights = np.zeros_like(r2)
    heights[inside] = np.maximum(top, 0.002)
    return heights


def relief(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A flat disc with fine, shallow relief."""
    r = np.hypot(x, y)
    inside = r < 0.055
    top = 0.012 + 0.0012 * np.sin(r[inside] / 0.0025) + 0.0008 * np.cos(x[inside] / 0.003) * np.sin(y[inside] / 0.004)
    heights = np.zeros_like(r)
    heights[inside] = top
    return heights


def with_values(images: Images, values: np.ndarray) -> Images:
    """The same images with other values (F, h, w)."""
    return replace(images, read=images.whole._replace(values=values).rows)


@dataclass(frozen=True)
class Scene:
    """Ground truth of each pixel of a height field."""

    height: Height
    calibration: Calibration
    points: np.ndarray  # (3, H, W) view frame
    normals: np.ndarray  # (H, W, 3)
    albedo: np.ndarray
    mask: np.ndarray

    @property
    def depth(self) -> np.ndarray:
        return -self.points[2]

    @property
    def graded(self) -> np.ndarray:
        """Pixels whose normal is within 78° of the ray, the mask eroded by one pixel."""
        ray = self.points / np.linalg.norm(self.points, axis=0)
        cosine = -np.einsum("hwc,chw->hw", self.normals, ray)
        core = np.zeros_like(self.mask)
        core[1:-1, 1:-1] = np.min([np.roll(self.mask, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)[
            1:-1, 1:-1
        ]
        return core & (cosine > np.cos(np.radians(78)))

    def error_deg(self, normals: np.ndarray) -> np.ndarray:
        """Angle to the true normal at the graded pixels."""
        cosine = np.sum(normals * self.normals, axis=-1)[self.graded]
        return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def scene(height: Height, known: Calibration, albedo: float = 0.5, table: float = 0.08) -> Scene:
    """Scene of a height field, by marching each pixel's ray down to it."""
    focal, middle = known.camera_matrix[0][0], known.camera_matrix[0][2]
    v, u = np.mgrid[: known.height, : known.width]
    x, y = (u - middle) / focal, -(v - middle) / focal
    depth = np.full(x.shape, TABLE_DEPTH - 0.12)
    for step in (1e-3, 1e-4, 1e-5, 1e-6):
        above = np.ones(x.shape, bool)
        while above.any():
            above &= TABLE_DEPTH - depth > height(x * depth, y * depth)
            depth = np.where(above, depth + step, depth)
        depth -= step
    depth += 1e-6
    px, py = x * depth, y * depth
    e = 2e-6
    gx = (height(px + e, py) - height(px - e, py)) / (2 * e)
    gy = (height(px, py + e) - height(px, py - e)) / (2 * e)
    normals = np.stack([-gx, -gy, np.ones_like(gx)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    mask = height(px, py) > 1e-4
    return Scene(height, known, np.stack([px, py, -depth]), normals, np.where(mask, albedo, table), mask)


def lit(true: Scene, light: Light) -> np.ndarray:
    """Noise-free values y (H, W): attached and cast shadows, 1/r², lobe."""
    known = true.calibration
    lamp = np.array(light.position)[:, None, None] - true.points
    r = np.linalg.norm(lamp, axis=0)
    unit = lamp / r
    cosine = np.maximum(np.einsum("hwc,chw->hw", true.normals, unit), 0)
    lobe = np.maximum(-np.einsum("c,chw->hw", np.array(light.axis), unit), 0) ** known.lobe_exponent
    visible = np.ones(r.shape, bool)
    # Rays are marched where anything depends on them, as long as something can stand in their way.
    index, top = np.flatnonzero(cosine * lobe > 0), highest(true.height)
    point, along = (part.reshape(3, -1)[:, index] for part in (true.points, unit))
    steps = np.concatenate([np.linspace(2e-4, 0.02, 60), np.linspace(0.021, 0.14, 120)])
    for part in np.split(steps, 9):
        free = np.ones(len(index), bool)
        for t in part:
            x, y, z = point + along * t
            free &= z + TABLE_DEPTH > true.height(x, y) - 5e-5
        visible.flat[index[~free]] = False
        left = free & ((z + TABLE_DEPTH < top) | (along[2] < 0))
        index, point, along = index[left], point[:, left], along[:, left]
    return true.albedo * cosine * lobe * (known.reference_m / r) ** 2 * visible


@lru_cache(maxsize=32)
def highest(height: Height) -> float:
    """A height, m, above all of a height field within 0.25 m of the middle: its maximum on a grid of 1 mm, and 5 mm."""
    x, y = np.meshgrid(*2 * [np.arange(-0.25, 0.25, 0.001)])
    return float(np.max(height(x, y))) + 0.005


class Frames:
    """Frames in memory, by path."""

    def __init__(self) -> None:
        self.stored: dict[str, np.ndarray] = {}

    def rows(self, frame: FrameRef, start: int, stop: int) -> np.ndarray:
        return self.stored[frame.path][start:stop]


def capture(
    true: Scene,
    lights: Sequence[Light],
    seed: int = 0,
    intensity_sigma: float = 0.01,
    position_sigma_m: float = 0.001,
    exposure_s: float | None = None,
    noisy: bool = True,
    brightness: Sequence[float] | None = None,
) -> Observations:
    """Simulates one image per light, with errors unknown to the solver, and the lamp-off frames; `brightness` is the
    lamp's in each image over the calibrated one."""
    rng = np.random.default_rng(seed)
    known = true.calibration
    frames = Frames()
    shots: list[Shot] = []
    darks: dict[float, Shot] = {}

    def shot(name: str, signal: np.ndarray, seconds: float, number: int, light: Light | None) -> Shot:
        sensor = known.sensor
        electrons = np.minimum(
            signal * seconds * known.lamp_intensity * sensor.full_scale_dn * sensor.gain_e_per_dn, 5e4
        )
        if noisy:
            electrons = rng.poisson(electrons) + rng.normal(0, sensor.read_noise_e, electrons.shape)
        dn = sensor.black_level_dn + np.minimum(electrons, sensor.full_well_e) / sensor.gain_e_per_dn
        frames.stored[name] = np.clip(np.round(dn), 0, 2**sensor.bits - 1).astype(np.uint16)
        return Shot(
            key=ShotKey(pass_number=0, number=number),
            kind="dark" if light is None else "light",
            frame=FrameRef(path=name, width=known.width, height=known.height, sha256=""),
            exposure_s=seconds,
            light=light,
            taken_at=0.0,
            quality=FrameQuality(saturated=0.0, bright_level=0.8, accepted=True),
        )

    for number, light in enumerate(lights):
        moved = np.array(light.position) + rng.normal(0, position_sigma_m, 3)
        signal = lit(true, Light(position=tuple(moved), axis=light.axis)) * (1 + rng.normal(0, intensity_sigma))
        if brightness is not None:
            signal = signal * brightness[number]
        seconds = exposure_s or float(f"{0.8 / (known.lamp_intensity * np.percentile(signal[true.mask], 99.5)):.4g}")
        shots.append(shot(f"{number}.tiff", signal, seconds, number, light))
        if seconds not in darks:
            darks[seconds] = shot(f"dark_{number}.tiff", np.zeros_like(signal), seconds, number, None)
    return Observations(shots=shots, darks=darks, frames=frames)


class Dome:
    """A reach without an arm: spread candidates, some refused."""

    def __init__(self, seed: int = 0, count: int = 300, refused: float = 0.25, min_slant_deg: float = 8.0) -> None:
        rng = np.random.default_rng(seed)
        cosine = np.linspace(np.cos(np.radians(min_slant_deg)), np.cos(np.radians(75)), count)
        units = geometry.direction(np.arccos(cosine), np.arange(count) * np.pi * (3 - np.sqrt(5)))
        self.radius_m = 0.45
        self.center = np.array([0.0, 0.0, -(TABLE_DEPTH - 0.03)])
        self.refused_units = units[rng.permutation(count)[: int(refused * count / 4)]] if refused else np.empty((0, 3))
        kept = [u for u in units if not len(self.refused_units) or np.max(self.refused_units @ u) < np.cos(0.07)]
        self.candidates = self.center + self.radius_m * np.array(kept)

    def allows(self, position: np.ndarray) -> Refusal | None:
        unit = (np.asarray(position) - self.center) / np.linalg.norm(np.asarray(position) - self.center)
        if unit[2] < np.cos(np.radians(76)):
            return Refusal(reason="too-far", detail="below the dome")
        return None


def ring(count: int, slant_deg: float, turn: float = 0.0) -> list[Light]:
    """Lights on one ring round the object."""
    center = Dome(refused=0).center
    lights = []
    for azimuth in turn + np.arange(count) * 2 * np.pi / count:
        unit = geometry.direction(np.radians(slant_deg), azimuth)
        position = center + 0.45 * unit
        lights.append(Light(position=tuple(position.tolist()), axis=tuple((-unit).tolist())))
    return lights
