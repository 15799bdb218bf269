"""Objects by their description: which options describe one, what does not fit the keep-out, what a mesh looks like."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from acquisition.models import cell_config
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import families, nominal, object_spec, render
from hardware_sim.object_spec import ObjectSpec, choose
from hardware_sim.reflectance import Reflectance
from hardware_sim.render import Lamp, Lens
from hardware_sim.tracing import Tracer

CELL_FILE = nominal.default_cell_file()


@pytest.fixture(scope="module")
def cell() -> CellConfig:
    return cell_config.load(CELL_FILE)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(3, 45.0).export(path)
    return path


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("vase", Path("a.stl"), None, None, None), "--object and --mesh"),
        (("vase", None, None, "knot", None), "--object and --family"),
        ((None, Path("a.stl"), None, "knot", "lambert"), "--mesh and --family"),
        (("vase", Path("a.stl"), 9.0, "knot", None), "--object and --mesh and --family"),
        ((None, None, 9.0, None, None), "--size-mm"),
        (("vase", None, 9.0, None, None), "--size-mm"),
        ((None, None, 9.0, "knot", None), "--size-mm"),
    ],
)
def test_choose_options_that_conflict_are_refused(
    options: tuple[str | None, Path | None, float | None, str | None, str | None], said: str
) -> None:
    with pytest.raises(RigError, match=said) as caught:
        choose(*options)
    assert caught.value.code == ErrorCode.REQUEST_INVALID


@pytest.mark.parametrize(
    ("options", "spec"),
    [
        ((None, None, None, None, None), ObjectSpec("vase")),
        (("part-glossy", None, None, None, "metal:0.3"), ObjectSpec("part-glossy", reflectance="metal:0.3")),
        ((None, Path("/a/b.stl"), 80.0, None, "ggx:0.2"), ObjectSpec("/a/b.stl", "mesh", 80.0, "ggx:0.2")),
        ((None, None, None, "knot", None), ObjectSpec("knot", "family")),
    ],
)
def test_choose_describes_one_object(
    options: tuple[str | None, Path | None, float | None, str | None, str | None], spec: ObjectSpec
) -> None:
    assert choose(*options) == spec
    assert ObjectSpec.from_json(spec.as_json()) == spec


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        (ObjectSpec("teapot"), "teapot.*figure"),
        (ObjectSpec("teapot", "family"), "teapot.*turned.*sheet"),
        (ObjectSpec("vase", reflectance="velvet"), "velvet.*oren-nayar"),
        (ObjectSpec("vase", reflectance="ggx:3"), "ggx"),
        (ObjectSpec("/no/where.stl", "mesh"), r"where\.stl"),
    ],
)
def test_check_unknown_object_is_refused_by_name(spec: ObjectSpec, said: str) -> None:
    with pytest.raises(RigError, match=said) as caught:
        object_spec.check(spec, 1, CELL_FILE)
    assert caught.value.code == ErrorCode.REQUEST_INVALID


@pytest.mark.parametrize("extents", [(190.0, 40.0, 40.0), (40.0, 40.0, 150.0)])
def test_build_mesh_too_large_tells_size_that_fits(
    tmp_path: Path, cell: CellConfig, extents: tuple[float, float, float]
) -> None:
    path = tmp_path / "beam.stl"
    trimesh.creation.box(extents).export(path)
    with pytest.raises(RigError, match=r"beam\.stl.*radius 85\.0 mm, height 110\.0 mm.*--size-mm") as caught:
        object_spec.build(ObjectSpec(str(path), "mesh"), 1, cell)
    assert caught.value.code == ErrorCode.CONFIG_INVALID
    fits = int(caught.value.detail.split("--size-mm ")[1].split()[0])
    assert object_spec.build(ObjectSpec(str(path), "mesh", fits), 1, cell).radius_m <= cell.object.keep_out.radius_m
    with pytest.raises(RigError):
        object_spec.build(ObjectSpec(str(path), "mesh", fits + 1), 1, cell)


def test_build_family_is_that_of_its_seed(cell: CellConfig) -> None:
    scene = object_spec.build(ObjectSpec("relief", "family"), 2, cell)
    made = families.make("relief", 2)
    assert np.array_equal(scene.mesh.triangles, made.mesh.triangles)
    assert scene.reflectance == made.reflectance
    assert scene.gloss == 0


def test_build_family_too_large_is_scaled_to_keep_out(cell: CellConfig) -> None:
    keep_out = cell.object.keep_out.model_copy(update={"height_m": 0.03})
    low = cell.model_copy(update={"object": cell.object.model_copy(update={"keep_out": keep_out})})
    scene = object_spec.build(ObjectSpec("blob", "family"), 3, low)
    assert scene.height_m == pytest.approx(0.03, rel=2e-4)
    assert scene.height_m <= 0.03
    made = families.make("blob", 3).mesh.triangles
    assert np.ptp(scene.mesh.triangles[..., 0]) / np.ptp(made[..., 0]) == pytest.approx(
        0.03 / made[..., 2].max(), rel=1e-3
    )


@pytest.mark.parametrize("text", ["lambert", "oren-nayar:0.35", "ggx:0.2", "metal:0.3"])
def test_build_reflectance_replaces_gloss(cell: CellConfig, ball: Path, text: str) -> None:
    for spec in (ObjectSpec("sphere-glossy"), ObjectSpec(str(ball), "mesh"), ObjectSpec("relief", "family")):
        scene = object_spec.build(replace(spec, reflectance=text), 2, cell)
        assert scene.reflectance == Reflectance.parse(text)
        assert scene.gloss == 0


def test_build_mesh_of_built_in_sphere_gives_its_image(tmp_path: Path, cell: CellConfig) -> None:
    built_in = object_spec.build(ObjectSpec("sphere"), 1, cell)
    corners = built_in.mesh.triangles.reshape(-1, 3)
    path = tmp_path / "sphere.stl"
    trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False).export(path)
    from_file = replace(object_spec.build(ObjectSpec(str(path), "mesh"), 1, cell), texture=built_in.texture)
    pixels = 96
    camera = Lens(
        pixels,
        pixels,
        np.array(nominal.calibration(pixels).camera_matrix),
        np.zeros(5),
        np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 0.9], [0, 0, 0, 1]]),
    )
    position = np.array([0.2, -0.1, 0.38])
    lamp = Lamp(position, -position / np.linalg.norm(position), 1.0, 0.45, 0.8)
    images = []
    for scene in (built_in, from_file):
        tracer = Tracer(scene.mesh)
        images.append(render.direct_image(render.trace_view(scene, tracer, camera, 2), scene, tracer, lamp))
    # The normals of the file's are means over facets of 0.7°, not the sphere's own.
    assert np.abs(images[0] - images[1]).max() < 2e-3 * images[0].max()
    assert images[0].max() > 0.3
