"""Link shapes of the UR15, UR20 and UR30, estimated by stretching the UR10e's.

The maker's meshes of these arms are under terms of their own ("Graphical Documentation") and are not shipped. All large
arms have the same construction, so the UR10e's meshes (BSD-3-Clause) are stretched to the published lengths: along the
links to a₂ and a₃ with the joint housings kept in shape, across them by the largest ratio of published lengths, and
sideways to the positions of upper arm, forearm and flange in `ur_description`. Planning uses still wider shapes: the
capsules enclose the stretched meshes by `MARGIN_M`. Check: they contain nearly all of the link capsules that another
project publishes for its UR20 (`tests/acquisition/waypoints/test_arm_models.py`).

    python -m acquisition.waypoints.estimated_links FOLDER

writes `arm_models.json`, `meshes/*.npz`, and STL files to FOLDER. From these, `python -m hardware_sim.link_spheres
FOLDER` makes the shapes by which the simulated arm detects contact.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from acquisition.models import stl
from acquisition.models.base import FloatArray
from acquisition.waypoints import kinematics
from acquisition.waypoints.kinematics import ArmModel
from acquisition.waypoints.link_meshes import LinkMesh, link_meshes

SOURCE = "ur10e"
MARGIN_M = 0.008
"""Distance, m, by which the capsules exceed the stretched meshes, because the true sizes differ from these."""
_EXACT_M = 0.001  # accuracy of the fit of capsules to samples of a surface
_SAMPLES = 20_000  # points of a link's surface
_TUBES_M = (0.1762, 0.0393)  # UR10e: middle lines of upper arm and forearm along z (`ur_description`)


@dataclass(frozen=True)
class Stretch:
    """How one arm's links follow from the UR10e's; lengths, m, along z of the links' frames.

    `across`: factor of all widths, the largest ratio of published lengths (d₅ or d₆). `interface`: where the upper arm
    begins. `tubes`: middle lines of upper arm and forearm. `wrist`: where the forearm ends. `flange`: the length of the
    last link.
    """

    across: float
    interface: float
    tubes: tuple[float, float]
    wrist: float
    flange: float


# Offsets of the meshes in `ur_description`, config/ur15|ur20|ur30/visual_parameters.yaml and physical_parameters.yaml.
# The UR15's middle lines are missing there: interpolated between UR10e and UR20 in the ratio of the centres of mass.
_LARGE = Stretch(across=1.33, interface=0.109, tubes=(0.260, 0.043), wrist=0.141, flange=0.070)
STRETCHES = {
    "ur15": Stretch(across=1.231, interface=0.100, tubes=(0.227, 0.045), wrist=0.1322, flange=0.0715),
    "ur20": _LARGE,
    "ur30": _LARGE,
}


def stretched(points: FloatArray, link: int, model: ArmModel) -> FloatArray:
    """Moves points (N, 3) of a UR10e link, in its Denavit–Hartenberg frame, to their place on `model`."""
    stretch, source = STRETCHES[model.name], kinematics.arm_model(SOURCE)
    moved = points * stretch.across
    if link in (2, 3):
        before, after = abs(float(source.dh[link - 1])), abs(float(model.dh[link - 1]))
        far = points[:, 0] > before / 2  # the housings at both ends keep their shape, the tube between is stretched
        moved[:, 0] = np.where(far, after - stretch.across * (before - points[:, 0]), moved[:, 0])
        tube, new = _TUBES_M[link - 2], stretch.tubes[link - 2]
        low, high = (0.0948, 0.2694) if link == 2 else (-0.0188, 0.106)  # extents of the UR10e's meshes
        new_low = stretch.interface if link == 2 else new - stretch.across * (tube - low)
        new_high = new + stretch.across * (high - tube) if link == 2 else stretch.wrist
        moved[:, 2] = np.interp(points[:, 2], [low, tube, high], [new_low, new, new_high])
    if link == 6:
        moved[:, 2] = points[:, 2] * stretch.flange / 0.0489
    return moved


def meshes(model: ArmModel) -> list[LinkMesh]:
    """Returns the seven stretched meshes: convex hulls, as the originals are convex."""
    links: list[LinkMesh] = []
    for mesh in link_meshes(SOURCE):
        hull = ConvexHull(stretched(mesh.vertices.astype(float), mesh.link, model))
        corners = hull.points[hull.vertices]
        number = np.zeros(len(hull.points), dtype=np.uint16)
        number[hull.vertices] = np.arange(len(corners), dtype=np.uint16)
        faces = number[hull.simplices]
        normals = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
        inwards = np.einsum("fi,fi->f", normals, hull.equations[:, :3]) < 0.0
        faces[inwards] = faces[inwards][:, ::-1]
        links.append(LinkMesh(mesh.link, mesh.name, corners.astype(np.float32), faces))
    return links


def capsules(model: ArmModel) -> list[tuple[int, FloatArray, FloatArray, float]]:
    """Returns link, start, end and radius of the UR10e's capsules, stretched, each as wide as its part of the link."""
    source = kinematics.arm_model(SOURCE)
    rows: list[tuple[int, FloatArray, FloatArray, float]] = []
    for mesh in link_meshes(SOURCE):
        chosen = [number for number, link in enumerate(source.capsule_links) if link == mesh.link]
        own = source.capsules[chosen]
        points = _surface(mesh)
        nearest = np.argmin([_to_segment(points, row[:3], row[3:6]) - row[6] for row in own], axis=0)
        moved = stretched(points, mesh.link, model)
        for number, row in enumerate(own):
            start, end = stretched(row[:6].reshape(2, 3), mesh.link, model)
            radius = float(_to_segment(moved[nearest == number], start, end).max())
            rows.append((mesh.link, start.round(4), end.round(4), round(radius + _EXACT_M + MARGIN_M, 4)))
    return rows


def _surface(mesh: LinkMesh) -> FloatArray:
    """Samples points (N, 3) all over a mesh; its corners are among them."""
    corners = mesh.vertices.astype(float)[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    random = np.random.default_rng(0)
    shares = random.dirichlet((1.0, 1.0, 1.0), _SAMPLES)
    chosen = corners[random.choice(len(corners), _SAMPLES, p=areas / areas.sum())]
    return np.vstack([mesh.vertices.astype(float), np.einsum("nc,nci->ni", shares, chosen)])


def _to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    along, away = end - start, points - start
    share = np.clip(away @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.linalg.norm(away - share[:, None] * along, axis=1)


def main(folder: Path) -> None:
    """Writes the shapes of the estimated arms into the service's tables, and STL files to FOLDER/<model>."""
    here = Path(__file__).parent
    table = here / "arm_models.json"
    text = table.read_text(encoding="utf-8")
    for name in STRETCHES:
        model = kinematics.arm_model(name)
        rows = [[link, start.tolist(), end.tolist(), radius] for link, start, end, radius in capsules(model)]
        head, key, tail = text.partition(f'"{name}": {{')
        before, capsules_key, after = tail.partition('"capsules": [')
        listed = "".join(f"\n    {json.dumps(row)}," for row in rows).removesuffix(",")
        text = (
            head
            + key
            + before
            + capsules_key
            + listed
            + "\n   ]"
            + after.partition("]\n  }")[1].removeprefix("]")
            + after.partition("]\n  }")[2]
        )
        arrays: dict[str, np.ndarray] = {}
        (folder / name).mkdir(parents=True, exist_ok=True)
        for mesh in meshes(model):
            stem = f"{mesh.link}_{mesh.name}"
            arrays |= {f"{stem}_vertices": mesh.vertices, f"{stem}_faces": mesh.faces}
            (folder / name / f"{stem}.stl").write_bytes(stl.encoded(mesh.vertices, mesh.faces))
        (folder / name / "estimated").touch()  # tells `hardware_sim.link_spheres` how coarsely to pack the spheres
        np.savez_compressed(here / "meshes" / f"{name}.npz", allow_pickle=False, **arrays)
    table.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
