"""Machined parts: a plate, disc or gear with random steps, bosses, ramps, fins, blind holes, slots and chamfers."""

from collections.abc import Callable
from functools import reduce

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.families import fields
from hardware_sim.families.contour import contour
from hardware_sim.implicit import Field
from hardware_sim.sheets import Mesh

SPACING = 1 / 150
"""Lattice of the contouring, in parts of the largest extent: 0.5–0.9 mm."""


def shape(random: np.random.Generator) -> Mesh:
    """A part of about unit length, its floor at z = 0."""
    outline, reach = _outline(random)
    plate = random.uniform(0.08, 0.2)
    chamfer = random.choice([0.0, random.uniform(0.01, 0.03)])
    added = [fields.prism(outline, 0.0, plate, chamfer)]
    cut: list[Field] = []
    places: list[FloatArray] = []
    makers = random.permutation(np.array([_boss, _boss, _block, _fins, _ramp, _post, _ring], dtype=object))
    for make in makers[: int(random.integers(2, 6))]:
        places.append(_apart(random, reach, places))
        added.append(make(random, places[-1], plate))
    cutters = random.permutation(np.array([_hole, _hole, _counterbore, _slot, _slot, _pocket, _dimple], dtype=object))
    for make in cutters[: int(random.integers(2, 7))]:
        places.append(_apart(random, reach, places))
        cut.append(make(random, places[-1], plate))

    def field(points: FloatArray) -> FloatArray:
        centred = points + np.array([0.0, 0.0, 0.3])
        solid = reduce(np.minimum, (part(centred) for part in added))
        solid = np.maximum(solid, outline(centred[..., :2]))
        return reduce(np.maximum, (-part(centred) for part in cut), solid)

    return contour(field, np.array([0.58, 0.58, 0.38]), SPACING)


def _apart(random: np.random.Generator, reach: FloatArray, others: list[FloatArray]) -> FloatArray:
    """The one of four random places that is farthest from all others; features may still overlap."""
    tries = random.uniform(-0.8, 0.8, (4, 2)) * reach
    if not others:
        return tries[0]
    distance = np.linalg.norm(tries[:, None] - np.array(others), axis=2).min(axis=1)
    return tries[int(distance.argmax())]


def _turn(random: np.random.Generator) -> FloatArray:
    """A random rotation of the plane; half of them keep to the axes."""
    angle = random.choice([0.0, np.pi / 2, random.uniform(0, np.pi), random.uniform(0, np.pi)])
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _outline(random: np.random.Generator) -> tuple[Field, FloatArray]:
    """The part's outline from above, and the half-lengths of the region for its features."""
    kind = random.choice(["plate", "rounded", "disc", "gear", "angle", "hexagon"])
    x, y = 0.5, random.uniform(0.28, 0.5)
    if kind == "disc":
        return fields.disc(0.5), np.array([0.4, 0.4])
    if kind == "gear":
        return _gear(random), np.array([0.33, 0.33])
    if kind == "hexagon":
        return fields.polygon(6, 0.43), np.array([0.36, 0.36])
    if kind == "rounded":
        radius = random.uniform(0.05, 0.2)
        inner = fields.box((x - radius, y - radius))
        return lambda points: inner(points) - radius, np.array([x, y])
    plate = fields.box((x, y))
    if kind == "plate":
        return plate, np.array([x, y])
    notch = fields.moved(fields.box((x, y)), np.array([x + random.uniform(-0.3, 0.2), y]), np.eye(2))
    return lambda points: np.maximum(plate(points), -notch(points)), np.array([x, y])


def _gear(random: np.random.Generator) -> Field:
    """A disc with tapered teeth: one tooth is evaluated in the sector of each point."""
    count = int(random.integers(9, 30))
    depth = min(random.uniform(0.05, 0.1), 1.5 / count)
    root = 0.5 - depth
    half = np.pi * root / count * random.uniform(0.45, 0.6)
    taper = random.uniform(0.1, 0.45)
    tilt = np.hypot(1.0, taper)

    def field(points: FloatArray) -> FloatArray:
        radius = np.hypot(points[..., 0], points[..., 1])
        sector = 2 * np.pi / count
        angle = np.mod(np.arctan2(points[..., 1], points[..., 0]), sector) - sector / 2
        along, across = radius * np.cos(angle), np.abs(radius * np.sin(angle))
        tooth = np.maximum((across - half + taper * (along - root)) / tilt, along - 0.5)
        # Beyond a sector's middle the next tooth is as near; the distance is a bound with a slope of at most 1.
        return np.minimum(radius - root, np.maximum(tooth, root / 2 - along))

    return field


Maker = Callable[[np.random.Generator, FloatArray, float], Field]


def _standing(random: np.random.Generator, outline: Field, place: FloatArray, high: float) -> Field:
    chamfer = random.choice([0.0, random.uniform(0.008, 0.03)])
    return fields.prism(fields.moved(outline, place, _turn(random)), 0.0, high, chamfer)


def _boss(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    radius = random.uniform(0.06, 0.16)
    outline = fields.disc(radius) if random.random() < 0.6 else fields.polygon(6, radius)
    return _standing(random, outline, place, plate + random.uniform(0.04, 0.3))


def _block(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    half = random.uniform(0.06, 0.3, 2)
    return _standing(random, fields.box(half), place, plate + random.uniform(0.03, 0.22))


def _post(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """A boss with a hole in it."""
    radius = random.uniform(0.08, 0.16)
    bore = random.uniform(0.4, 0.75) * radius
    outline, hole = fields.disc(radius), fields.disc(bore)
    return _standing(
        random, lambda points: np.maximum(outline(points), -hole(points)), place, plate + random.uniform(0.04, 0.25)
    )


def _ring(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """A round bead on the plate."""
    ring = fields.torus(random.uniform(0.1, 0.22), random.uniform(0.02, 0.05))
    return fields.moved(ring, np.array([*place, plate]), np.eye(3))


def _fins(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """Parallel ribs: one rib is evaluated in the strip of each point."""
    count, pitch = int(random.integers(3, 9)), random.uniform(0.055, 0.11)
    thick, length = pitch * random.uniform(0.2, 0.35), random.uniform(0.12, 0.3)

    def outline(points: FloatArray) -> FloatArray:
        strip = np.clip(np.round(points[..., 0] / pitch), -(count // 2), (count - 1) // 2)
        local = np.stack([points[..., 0] - pitch * strip, points[..., 1]], axis=-1)
        return fields.box((thick, length))(local)

    high = plate + random.uniform(0.06, 0.22)
    return fields.prism(fields.moved(outline, place * 0.4, _turn(random)), 0.0, high)


def _ramp(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """A wedge."""
    half, slope = random.uniform(0.1, 0.28, 2), random.uniform(0.15, 0.7)
    turn = _turn(random)
    outline = fields.moved(fields.box(half), place, turn)
    tilt = np.hypot(1.0, slope)
    middle = plate + slope * half[0] * random.uniform(0.3, 1.0)

    def field(points: FloatArray) -> FloatArray:
        along = (points[..., :2] - place) @ turn[:, 0]
        roof = (points[..., 2] - middle - slope * along) / tilt
        return np.maximum(np.maximum(outline(points[..., :2]), roof), np.abs(points[..., 2] - 0.27) - 0.27)

    return field


def _sunk(random: np.random.Generator, outline: Field, place: FloatArray, plate: float) -> Field:
    """A blind cut from above into the plate."""
    return fields.prism(fields.moved(outline, place, _turn(random)), plate * random.uniform(0.15, 0.75), 1.0)


def _hole(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    return _sunk(random, fields.disc(random.uniform(0.03, 0.12)), place, plate)


def _counterbore(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """A hole with a wide upper part, or a countersunk one."""
    wide, depth = random.uniform(0.07, 0.14), plate * random.uniform(0.2, 0.5)
    narrow = _hole(random, place, plate)
    if random.random() < 0.5:
        upper = fields.prism(fields.moved(fields.disc(wide), place, np.eye(2)), plate - depth, 1.0)
    else:
        upper = fields.moved(fields.cone(0.0, 2 * wide, 2 * wide), np.array([*place, plate]), np.eye(3))
    return lambda points: np.minimum(narrow(points), upper(points))


def _slot(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    half = random.uniform(0.08, 0.3)
    return _sunk(random, fields.capsule((-half, 0.0), (half, 0.0), random.uniform(0.02, 0.06)), place, plate)


def _pocket(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    return _sunk(random, fields.box(random.uniform(0.06, 0.2, 2)), place, plate)


def _dimple(random: np.random.Generator, place: FloatArray, plate: float) -> Field:
    """A cut by a ball mill."""
    radius = random.uniform(0.08, 0.25)
    high = max(plate + radius * random.uniform(0.0, 0.7), radius + 0.02)
    return fields.moved(fields.sphere(radius), np.array([*place, high]), np.eye(3))
