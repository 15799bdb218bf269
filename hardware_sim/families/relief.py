"""Reliefs: a height field of noise with a random spectrum on a block, some with terraces, letters or ridges."""

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from acquisition.models.base import FloatArray
from hardware_sim.families.noise import spectral
from hardware_sim.families.surfaces import creased, grid, welded
from hardware_sim.sheets import Mesh

SIZE = 240
"""Points along either side of the height field: 0.3–0.5 mm apart."""


def shape(random: np.random.Generator) -> Mesh:
    """A slab or a disc of unit length with a relief on top."""
    width = random.uniform(0.6, 1.0)
    depth = np.exp(random.uniform(np.log(0.015), np.log(0.16)))
    shortest = random.uniform(0.02, 0.10)
    heights = depth / 2 * spectral(random, SIZE, shortest, 0.9, random.uniform(0.6, 2.6))
    style = random.choice(["noise", "terraces", "letters", "ridges"])
    if style == "terraces":
        step = depth / random.integers(3, 7)
        heights = step * np.round(heights / step) + 0.1 * heights
    elif style == "letters":
        heights = 0.4 * heights + np.exp(random.uniform(np.log(0.008), np.log(0.04))) * _letters(random)
    elif style == "ridges":
        heights = depth / 2 - 2 * np.abs(heights)
    base = 0.04 + random.uniform(0.0, 0.1) - heights.min()
    v, u = np.meshgrid(*[np.linspace(-1, 1, SIZE)] * 2)
    if random.random() < 0.3:  # a disc: the square's elliptical image
        u, v = u * np.sqrt(1 - v**2 / 2), v * np.sqrt(1 - u**2 / 2)
    top = np.stack([u / 2, v * width / 2, base + heights], axis=-1)
    return _block(top)


def _letters(random: np.random.Generator) -> FloatArray:
    """Characters and frames (SIZE, SIZE), raised (0 to 1) or sunk (0 to −1), with edges one or two points wide."""
    image = np.zeros((SIZE, SIZE), dtype=np.uint8)
    alphabet = np.array(list("ABCDEFGHKLMNPRSTWXYZ0123456789&"))
    rows = int(random.integers(1, 4))
    for row in range(rows):
        text = "".join(random.choice(alphabet, int(random.integers(2, 5))))
        (wide, high), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 1)
        scale = min(0.85 * SIZE / wide, 0.6 * SIZE / rows / high)
        thickness = max(2, int(scale * random.uniform(2, 5)))
        corner = (int((SIZE - scale * wide) / 2), int(SIZE * (row + 0.5) / rows + scale * high / 2))
        cv2.putText(image, text, corner, cv2.FONT_HERSHEY_DUPLEX, scale, 255, thickness, cv2.LINE_AA)
    if random.random() < 0.5:  # a frame
        edge = int(random.integers(4, 14))
        cv2.rectangle(image, (edge, edge), (SIZE - edge, SIZE - edge), 255, int(random.integers(2, 6)))
    soft = gaussian_filter(image / 255.0, random.uniform(0.4, 2.0))
    return np.asarray(soft[::-1].T if random.random() < 0.7 else -soft[::-1].T, dtype=np.float64)


def _block(top: FloatArray) -> Mesh:
    """Closes a block below its top (R, C, 3), by walls down to z = 0 and a floor."""
    edge = np.concatenate([top[:-1, 0], top[-1, :-1], top[:0:-1, -1], top[0, :0:-1]])
    foot = edge * np.array([1.0, 1.0, 0.0])
    middle = np.broadcast_to(np.array([*top[..., :2].mean(axis=(0, 1)), 0.0]), edge.shape)
    parts = [grid(top), grid(np.stack([edge, foot, middle]), around=True)]
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return creased(*welded(vertices, np.concatenate([parts[0][1], parts[1][1] + len(parts[0][0])])))
