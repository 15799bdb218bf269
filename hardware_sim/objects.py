"""Built-in objects of the simulated cell: a shape, a finish, and a seed that varies both.

A name is a shape (`sphere`, `vase`, `relief`, `part`, `bumps`, `figure`), or a shape and a finish joined by a dash:
`-matt` (one albedo near 0.6), `-textured` (patches between 0.3 and 0.7 with clear edges), `-glossy` (the plain finish
under a thin gloss), `-contrast` (patches of 0.03 and 0.9, polished). Without a finish the albedo drifts softly between
0.3 and 0.7.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import shapes
from hardware_sim.reflectance import Reflectance
from hardware_sim.sheets import Mesh

LAMBERT = Reflectance()
"""The reflectance of every built-in object."""

POLISHED = 200.0
"""Exponent of the gloss of finish `-contrast`: its highlights are 5° wide and saturate. The gloss of `-glossy`, 12°
wide, would cover the dark patches, which reflect less than it does."""

Finish = Literal["soft", "matt", "textured", "glossy", "contrast"]

SHAPES = {
    "sphere": shapes.sphere,
    "vase": shapes.vase,
    "relief": shapes.relief,
    "part": shapes.part,
    "bumps": shapes.bumps,
    "figure": shapes.figure,
}


@dataclass(frozen=True)
class Texture:
    """An albedo for each point of space: mean + half_range · tanh(sharpness · sum of waves)."""

    mean: float
    half_range: float
    sharpness: float
    waves: FloatArray  # (K, 3) rad/m
    phases: FloatArray  # (K,)

    def __call__(self, points: FloatArray | Float32Array) -> Float32Array:
        """Albedo (N,) at points (N, 3), m, object frame."""
        total = np.zeros(len(points), dtype=np.float32)
        for wave, phase in zip(self.waves.astype(np.float32), self.phases, strict=True):
            total += np.cos(points.astype(np.float32) @ wave + np.float32(phase))
        total *= np.float32(np.sqrt(2 / len(self.waves)))
        return (self.mean + self.half_range * np.tanh(self.sharpness * total)).astype(np.float32)


@dataclass(frozen=True)
class SceneObject:
    """An object of the cell in its own frame: it stands on z = 0 round the z axis.

    `texture` gives the albedo (N,) at points (N, 3). Gloss (Blinn–Phong) applies only to a Lambertian `reflectance`. It
    adds `gloss` · |E| · (n·h)^`gloss_exponent` to a pixel's light, where E is the lamp's irradiance on a surface that
    faces it and h points half-way between lamp and camera.
    """

    name: str
    mesh: Mesh
    texture: Callable[[FloatArray], FloatArray | Float32Array]
    gloss: float
    gloss_exponent: float
    reflectance: Reflectance = LAMBERT

    @cached_property
    def radius_m(self) -> float:
        """Radius, m, of the smallest cylinder round the z axis that holds the object."""
        return float(np.hypot(self.mesh.triangles[..., 0], self.mesh.triangles[..., 1]).max())

    @cached_property
    def height_m(self) -> float:
        """Height, m, of its highest point above the table."""
        return float(self.mesh.triangles[..., 2].max())


def names() -> list[str]:
    """All names that `build` knows."""
    return [shape if finish == "soft" else f"{shape}-{finish}" for shape in SHAPES for finish in get_args(Finish)]


def check_name(name: str) -> None:
    """Raises RigError request.invalid that lists the objects, unless `name` is one."""
    if name not in names():
        known = ", ".join(SHAPES)
        finishes = ", ".join(f"-{finish}" for finish in get_args(Finish) if finish != "soft")
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"there is no object {name!r}: choose one of {known}, alone or followed by one of {finishes}",
            object=name,
        )


def build(name: str, seed: int) -> SceneObject:
    """Makes an object. Raises RigError request.invalid as `check_name` does."""
    check_name(name)
    shape, _, finish = name.partition("-")
    random = _generator(shape, seed)
    mesh = SHAPES[shape](random)
    yaw = random.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    gloss = random.uniform(0.1, 0.2)
    return SceneObject(
        name=name,
        mesh=mesh.transformed(turn, np.zeros(3)),
        texture=_texture(finish or "soft", random),
        gloss=gloss if finish in ("glossy", "contrast") else 0.0,
        gloss_exponent=POLISHED if finish == "contrast" else 30.0,
    )


def soft_texture(name: str, seed: int) -> Texture:
    """Albedo for an object without its own: it drifts softly between 0.3 and 0.7, as without a finish."""
    return _texture("soft", _generator(name, seed))


def _generator(name: str, seed: int) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.sha256(f"{name} {seed}".encode()).digest()[:8], "big"))


def _texture(finish: str, random: np.random.Generator) -> Texture:
    count = 12
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shortest, longest = (0.016, 0.040) if finish in ("textured", "contrast") else (0.030, 0.090)
    waves = directions * (2 * np.pi / random.uniform(shortest, longest, count))[:, None]
    phases = random.uniform(0, 2 * np.pi, count)
    if finish == "matt":
        return Texture(random.uniform(0.55, 0.65), 0.0, 1.0, waves, phases)
    if finish == "contrast":
        return Texture(0.465, 0.435, 6.0, waves, phases)
    return Texture(0.5, 0.2, 6.0 if finish == "textured" else 0.8, waves, phases)
