"""Knots: tubes of varying radius, plain, ribbed or rope-like, along torus knots and random closed curves."""

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.families.surfaces import creased, grid
from hardware_sim.sheets import Mesh

ALONG, AROUND = 1000, 80
"""Points along and round the tube: 0.5–1 mm and 0.3–0.6 mm apart."""
TIGHTEST = 0.8
"""Largest ratio of the tube's radius to its bend's radius: at 1 the inside of the bend would fold over itself."""


def shape(random: np.random.Generator) -> Mesh:
    """A closed tube of about unit size that lies on the table."""
    line = _torus_knot(random) if random.random() < 0.55 else _closed_curve(random)
    line = _even(line)
    tangent = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    step = np.linalg.norm(tangent, axis=1, keepdims=True) / 2
    tangent /= 2 * step
    bend = np.linalg.norm(np.roll(tangent, -1, axis=0) - np.roll(tangent, 1, axis=0), axis=1) / (2 * step[:, 0])
    ribs, depth = int(random.choice([0, 0, 2, 3, 4, 6])), random.uniform(0.08, 0.22)
    beads, swell = int(random.integers(2, 14)), random.uniform(0.0, 0.4)
    phase = 2 * np.pi * np.arange(ALONG) / ALONG
    thick = random.uniform(0.05, 0.11) * (1 + swell * np.sin(beads * phase + random.uniform(0, 2 * np.pi)))
    thick = np.minimum(thick, TIGHTEST / (1 + (depth if ribs else 0)) / np.maximum(bend, 1e-6))
    # The minimum above has corners; a running mean along the tube removes them.
    window = np.ones(41) / 41
    thick = np.convolve(np.concatenate([thick[-20:], thick, thick[:20]]), window, mode="valid")

    first, second = _frame(tangent)
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    radius = np.broadcast_to(thick[:, None], (ALONG, AROUND))
    if ribs:  # whole turns, so that the ribs meet themselves
        turns = int(random.integers(-12, 13))
        radius = radius * (1 + depth * np.cos(ribs * angle + turns * phase[:, None]))
    points = line[:, None] + radius[..., None] * (
        np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    )
    # (first, second, tangent) is right-handed: along × round points inward.
    vertices, faces = grid(points, around=True, closed=True)
    return creased(vertices, faces[:, ::-1])


def _torus_knot(random: np.random.Generator) -> FloatArray:
    """The (p, q) torus knot with p turns round the axis, flattened by a random factor."""
    p, q = [(2, 3), (3, 2), (2, 5), (3, 4), (1, 4), (3, 5), (1, 0), (2, 7)][int(random.integers(8))]
    t = np.linspace(0, 2 * np.pi, 4 * ALONG, endpoint=False)
    inner = random.uniform(0.12, 0.19)
    radius = 0.32 + inner * np.cos(q * t)
    flat = random.uniform(0.6, 1.3)
    return np.stack([radius * np.cos(p * t), radius * np.sin(p * t), flat * inner * np.sin(q * t)], axis=1)


def _closed_curve(random: np.random.Generator) -> FloatArray:
    """A random closed curve of a few harmonics: the one of six with the least curvature."""
    t = np.linspace(0, 2 * np.pi, 4 * ALONG, endpoint=False)
    best, least = np.empty((0, 3)), np.inf
    for _ in range(6):
        line = np.zeros((len(t), 3))
        for harmonic in range(1, 5):
            a, b = random.normal(size=(2, 3)) / harmonic**1.3
            line += np.cos(harmonic * t)[:, None] * a + np.sin(harmonic * t)[:, None] * b
        line *= np.array([1.0, 1.0, 0.5])
        line *= 0.8 / np.ptp(line, axis=0).max()
        even = _even(line)
        turn = even + np.roll(even, 2, axis=0) - 2 * np.roll(even, 1, axis=0)
        tightest = float(np.percentile(np.linalg.norm(turn, axis=1), 99))
        if tightest < least:
            best, least = line, tightest
    return best


def _even(line: FloatArray) -> FloatArray:
    """`ALONG` points (ALONG, 3) at equal distances along a closed curve (N, 3)."""
    closed = np.concatenate([line, line[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    wanted = np.linspace(0, length[-1], ALONG, endpoint=False)
    return np.stack([np.interp(wanted, length, component) for component in closed.T], axis=1)


def _frame(tangent: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (N, 3) perpendicular to the tangents, with the least twist that closes on itself."""
    first = np.empty_like(tangent)
    across = np.cross(tangent[0], np.eye(3)[int(np.abs(tangent[0]).argmin())])
    for number, direction in enumerate([*tangent, tangent[0]]):
        across = across - (across @ direction) * direction
        across = across / np.linalg.norm(across)
        if number < len(tangent):
            first[number] = across
    # Carried once round, the frame has turned by an angle; the correction is spread evenly over the points.
    second = np.cross(tangent, first)
    gap = np.arctan2(across @ second[0], across @ first[0])
    angle = -gap * np.arange(len(tangent))[:, None] / len(tangent)
    return np.cos(angle) * first + np.sin(angle) * second, np.cos(angle) * second - np.sin(angle) * first
