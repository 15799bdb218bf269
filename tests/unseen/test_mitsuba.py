"""The path tracer against Mitsuba, an independent implementation of light transport, on a vessel and a knot.

`pytest -m long -s tests/unseen/test_mitsuba.py` prints the figures.
"""

import mitsuba
import numpy as np
import pytest

from hardware_sim.sheets import Mesh
from tests.unseen import scenes
from tests.unseen.brdf import Brdf
from tests.unseen.scenes import Scene
from tests.unseen.tracer import Lamp, Tracer

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

PIXELS, SAMPLES, DEPTH = 48, 4096, 40
SEED = 1
ALBEDO = 0.7
WEIGHT = 0.2
"""Weight of the conductor in the glossy mix."""
MATERIALS: dict[str, tuple[Brdf, dict[str, object]]] = {
    "lambert": (Brdf(), {"type": "diffuse", "reflectance": ALBEDO}),
    "metal": (
        Brdf(diffuse=0.0, alpha=0.3, f0=0.9, f90=0.9),
        {
            "type": "roughconductor",
            "material": "none",
            "distribution": "ggx",
            "alpha": 0.3,
            "specular_reflectance": 0.9,
        },
    ),
    "glossy": (
        Brdf(diffuse=1 - WEIGHT, alpha=0.2, f0=WEIGHT, f90=WEIGHT),
        {
            "type": "blendbsdf",
            "weight": WEIGHT,
            "base": {"type": "diffuse", "reflectance": ALBEDO},
            "coat": {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": 0.2},
        },
    ),
}


def plain(values: object) -> object:
    """A scene's description with grey values in Mitsuba's form."""
    if not isinstance(values, dict):
        return values
    grey = ("reflectance", "specular_reflectance")
    return {k: {"type": "rgb", "value": v} if k in grey else plain(v) for k, v in values.items()}


def mitsuba_mesh(mesh: Mesh, material: dict[str, object]) -> object:
    count = len(mesh.triangles)
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(plain(material))
    made = mitsuba.Mesh("object", vertex_count=3 * count, face_count=count, has_vertex_normals=True, props=properties)
    parameters = mitsuba.traverse(made)
    parameters["vertex_positions"] = mesh.triangles.astype(np.float32).ravel()
    parameters["vertex_normals"] = mesh.corner_normals.astype(np.float32).ravel()
    parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
    parameters.update()
    return made


def reference(one: Scene, lamp: np.ndarray, material: dict[str, object]) -> np.ndarray:
    """Mitsuba's values y (H, W) under an isotropic lamp."""
    if mitsuba.variant() is None:
        mitsuba.set_variant("scalar_rgb")
    described = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 100},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(one.pixels / 2 / one.focal_px))),
            "to_world": mitsuba.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": one.pixels, "height": one.pixels, "rfilter": {"type": "box"},
                "pixel_format": "rgb", "component_format": "float32",
            },
            "sampler": {"type": "multijitter"},
        },
        "lamp": {
            "type": "point", "position": lamp.tolist(),
            "intensity": {"type": "rgb", "value": np.pi * one.radius_m**2},
        },
        "object": mitsuba_mesh(one.mesh, material),
    }  # fmt: skip
    return np.array(mitsuba.render(mitsuba.load_dict(described), spp=SAMPLES, seed=1), dtype=np.float32)[..., 0]


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("family", ["vessel", "knot"])
def test_image_agrees_with_mitsuba_within_two_per_cent(family: str, material: str) -> None:
    one = scenes.scene(family, SEED, "lambert", PIXELS)
    brdf, described = MATERIALS[material]
    lamp = one.center + one.radius_m * np.array([0.5, 0.2, 0.84])
    made = Tracer(
        one.mesh, lambda points: np.full(len(points), ALBEDO), brdf, pixels=PIXELS, focal_px=one.focal_px,
        reference_m=one.radius_m, samples=8,
    )  # fmt: skip
    ours = made.render(Lamp(lamp, -one.axes(lamp[None])[0]))
    theirs = reference(one, lamp, described)
    where = one.truth.within_78_deg
    difference = (ours - theirs)[where]
    relative, bias = np.mean(np.abs(difference)) / np.mean(theirs[where]), np.mean(difference) / np.mean(theirs[where])
    print(f"\n{family}, {material}: mean |difference| {relative:.2%}, bias {bias:+.2%}")
    assert relative < 0.02
    assert abs(bias) < 0.01
