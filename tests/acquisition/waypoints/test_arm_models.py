"""Link shapes of the arms whose maker's meshes are not shipped: capsules round them, and another project's capsules."""

import numpy as np
import pytest

from acquisition.waypoints.estimated_links import MARGIN_M, STRETCHES, capsules
from acquisition.waypoints.kinematics import arm_model
from acquisition.waypoints.link_meshes import link_meshes

FloatArray = np.ndarray

# Link capsules of a UR20 as viam-modules/universal-robots publishes them (src/kinematics/ur20.json): link, middle,
# axis, length over the caps, radius; m. Its frames are at the links' near ends, ours at the far ones.
PUBLISHED = (
    (2, (-0.4216 + 0.862, 0.0, 0.260), (1.0, 0.0, 0.0), 1.032, 0.090),
    (3, (-0.360 + 0.7287, 0.0, 0.043), (1.0, 0.0, 0.0), 0.858, 0.075),
)


def outside(points: FloatArray, model_name: str, link: int) -> FloatArray:
    """Distances (N,) of points of a link's frame from its capsules, negative inside, m."""
    model = arm_model(model_name)
    rows = model.capsules[[number for number, own in enumerate(model.capsule_links) if own == link]]
    gaps: list[FloatArray] = []
    for row in rows:
        along, away = row[3:6] - row[:3], points - row[:3]
        share = np.clip(away @ along / max(along @ along, 1e-12), 0.0, 1.0)
        gaps.append(np.linalg.norm(away - share[:, None] * along, axis=1) - row[6])
    return np.min(gaps, axis=0)


@pytest.mark.parametrize("name", sorted(STRETCHES))
def test_estimated_capsules_enclose_meshes_with_margin(name: str) -> None:
    for mesh in link_meshes(name):
        corners = mesh.vertices.astype(float)[mesh.faces]
        shares = np.random.default_rng(1).dirichlet((1.0, 1.0, 1.0), (len(corners), 5))
        points = np.vstack([mesh.vertices, np.einsum("fsc,fci->fsi", shares, corners).reshape(-1, 3)])
        # 3 mm: facets of the stretched hull between the samples that the capsules were fitted to.
        assert outside(points, name, mesh.link).max() < 0.003 - MARGIN_M, mesh.name


def test_estimated_ur20_capsules_hold_published_ones() -> None:
    directions = np.random.default_rng(2).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for link, middle, axis, length, radius in PUBLISHED:
        half = (length / 2 - radius) * np.array(axis) * np.sign(directions @ np.array(axis))[:, None]
        points = np.array(middle) + half + radius * directions
        assert outside(points, "ur20", link).max() < 0.01, link  # its caps reach past the joints' housings


@pytest.mark.parametrize("name", sorted(STRETCHES))
def test_estimated_tables_are_those_of_generator(name: str) -> None:
    model = arm_model(name)
    for (link, start, end, radius), own, row in zip(capsules(model), model.capsule_links, model.capsules, strict=True):
        assert link == own
        assert np.allclose(row, [*start, *end, radius], atol=5e-4)


@pytest.mark.parametrize(("newer", "older"), [("ur7e", "ur5e"), ("ur12e", "ur10e")])
def test_newer_name_has_links_of_older_arm(newer: str, older: str) -> None:
    assert np.array_equal(arm_model(newer).capsules, arm_model(older).capsules)
    for mine, theirs in zip(link_meshes(newer), link_meshes(older), strict=True):
        assert np.array_equal(mine.vertices, theirs.vertices)
