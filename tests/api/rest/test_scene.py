"""The cell's geometry over HTTP: poses from joint angles, meshes, frustum, obstacles, lights, and their ETags."""

import json
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from acquisition import geometry, lamp_pose
from acquisition.models import cell_config
from acquisition.models.base import as_matrix4
from acquisition.waypoints import kinematics
from api.rest import settings
from api.rest.conditional import is_current
from api.rest.scene_schemas import SceneResource
from tests.api.conftest import write_cell
from tests.api.rest.test_calibrations import ID, keep

STL_HULL = """
[[obstacles]]
kind = "convex-mesh"
name = "wedge"
file = "wedge.stl"
base_from_mesh = { position_m = [0.2, -0.6, 0.1], rotation_vector_rad = [0.0, 0.0, 0.5] }

[[obstacles]]
kind = "box"
name = "cupboard"
base_from_box = { position_m = [-0.5, 0.6, 0.4], rotation_vector_rad = [0.0, 0.3, 0.0] }
half_extents_m = [0.1, 0.2, 0.4]
clearance_m = 0.05
"""


def scene_of(service: Any) -> SceneResource:
    return SceneResource.model_validate_json(service.http.get("/v1/rig/scene").content)


def link_poses(scene: SceneResource, joints: Any) -> list[Any]:
    """Base from each link, by the rows as the schema states them and by nothing else."""
    poses = [np.eye(4)]
    for row, angle in zip(scene.arm.joints, joints, strict=True):
        along = geometry.pose((0, 0, row.d_m), (0, 0, angle + row.theta_rad))
        poses.append(poses[-1] @ along @ geometry.pose((row.a_m, 0, 0), (row.alpha_rad, 0, 0)))
    return poses


def test_scene_chain_gives_link_poses_of_kinematics(shared: Any) -> None:
    scene = scene_of(shared)
    for joints in np.random.default_rng(1).uniform(-3, 3, (5, 6)):
        expected = kinematics.forward(kinematics.arm_model(scene.arm.model), joints[None])[0]
        assert np.allclose(link_poses(scene, joints), expected, atol=1e-9)


def test_scene_calibrated_chain_is_that_of_cell_file(tmp_path: Any, serving: Any) -> None:
    path = write_cell(tmp_path, "127.0.4.1")
    rows = "".join(
        f"[[arm.kinematics]]\ntheta_rad = {0.001 * n}\na_m = {0.1 * n}\nd_m = 0.1\nalpha_rad = 1.5\n" for n in range(6)
    )
    path.write_text(path.read_text(encoding="utf-8").replace("[lamp]", f"{rows}\n[lamp]"), encoding="utf-8")
    with serving(_settings(path, tmp_path)) as service:
        scene = scene_of(service)

    assert scene.arm.kinematics == "calibrated"
    assert [joint.theta_rad for joint in scene.arm.joints] == [0.001 * n for n in range(6)]


def test_scene_capsules_enclose_link_meshes(shared: Any) -> None:
    scene = scene_of(shared)
    for link in scene.arm.links:
        mesh = trimesh.load_mesh(trimesh.util.wrap_as_stream(shared.http.get(link.mesh).content), file_type="stl")
        assert mesh.is_watertight
        distance = np.min([_outside(mesh.vertices, capsule) for capsule in link.capsules], axis=0)
        assert distance.max() < 1e-3, link.name


def test_scene_mesh_is_immutable_and_others_are_refused(shared: Any) -> None:
    address = scene_of(shared).arm.links[3].mesh

    answer = shared.http.get(address)
    again = shared.http.get(address, headers={"If-None-Match": answer.headers["etag"]})

    assert answer.headers["content-type"] == "model/stl"
    assert "immutable" in answer.headers["cache-control"]
    assert len(answer.content) == 84 + 50 * int.from_bytes(answer.content[80:84], "little")
    assert (again.status_code, again.content) == (304, b"")
    for name in ("nothing.stl", "..%2fscene", "ur5e.npz"):
        assert shared.http.get(f"/v1/rig/scene/meshes/{name}").status_code == 404


def test_scene_corners_project_to_image_corners(shared: Any) -> None:
    camera = scene_of(shared).camera
    camera_from_base = geometry.inverse(np.array(camera.base_from_camera))
    points = geometry.transform(camera_from_base, np.array(camera.corners_m))

    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.array(camera.camera_matrix), np.array(camera.distortion)
    )

    assert np.allclose(points[:, 2], camera.object_depth_m)
    right, bottom = camera.width_px - 0.5, camera.height_px - 0.5
    assert np.allclose(pixels[:, 0], [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], atol=0.05)


def test_scene_etag_holds_until_reach_is_known(own: Any) -> None:
    first = own.http.get("/v1/rig/scene")
    unchanged = own.http.get("/v1/rig/scene", headers={"If-None-Match": f'"other", {first.headers["etag"]}'})
    refusal = {"reason": "too-far", "detail": "1.2 m from the shoulder"}
    reach = {"points": [[0.1, 0.2, -0.5], [0.3, 0.2, -0.6]], "refusals": [None, refusal]}
    own.service.runner.planning.reach_file.write_text(json.dumps(reach), encoding="utf-8")
    changed = own.http.get("/v1/rig/scene", headers={"If-None-Match": first.headers["etag"]})

    assert first.json()["lights"] is None
    assert (unchanged.status_code, unchanged.content) == (304, b"")
    assert unchanged.headers["etag"] == first.headers["etag"]
    assert changed.status_code == 200
    assert changed.json()["lights"][0] == {"position": [0.1, 0.2, -0.5], "refusal": None}
    assert changed.json()["lights"][1]["refusal"] == refusal


def test_scene_shows_camera_of_calibration_in_use(own: Any, tmp_path: Any) -> None:
    scene_of(own)  # encoded with the cell file's
    values = own.client.calibration().values
    moved = lamp_pose.base_from_view(values)[:3, 3] + [0, 0, 0.01]
    camera = np.array(values.base_from_camera)
    camera[2, 3] += 0.01
    keep(own, tmp_path / "made", base_from_camera=as_matrix4(camera))
    own.client.activate_calibration(ID)

    assert np.allclose(np.array(scene_of(own).base_from_view)[:3, 3], moved)


def test_scene_obstacles_have_shapes_and_hull(tmp_path: Any, serving: Any) -> None:
    path = write_cell(tmp_path, "127.0.4.1")
    path.write_text(path.read_text(encoding="utf-8") + STL_HULL, encoding="utf-8")
    wedge = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    (tmp_path / "wedge.stl").write_bytes(wedge.export(file_type="stl"))
    with serving(_settings(path, tmp_path)) as service:
        scene = scene_of(service)
        bodies = {body.name: body for body in scene.bodies}
        hull = trimesh.load_mesh(
            trimesh.util.wrap_as_stream(service.http.get(bodies["wedge"].mesh).content), file_type="stl"
        )

    assert [bodies[name].role for name in ("table", "camera", "wedge")] == ["table", "camera", "obstacle"]
    assert bodies["table"].kind == "half-space"
    assert bodies["cupboard"].clearance_m == 0.05
    assert np.allclose(np.array(bodies["cupboard"].base_from_box)[:3, 3], [-0.5, 0.6, 0.4])
    assert hull.is_watertight
    assert hull.volume == pytest.approx(wedge.volume, rel=1e-3)  # positive: its faces look outwards
    assert np.allclose(hull.centroid, [0.2, -0.6, 0.1], atol=1e-4)


def test_scene_lamp_and_dome_are_those_of_cell(shared: Any) -> None:
    scene, cell = scene_of(shared), shared.service.cell
    calibration = shared.service.calibration

    lamp = cell.arm.flange_from_tool.matrix @ np.array(calibration.tool_from_lamp)
    assert np.allclose(scene.tool.flange_from_lamp, lamp)
    assert np.allclose(scene.dome.center_m, [0.55, 0.0, 0.03])
    towards = np.array(scene.camera.base_from_camera)[:3, 3] - scene.dome.center_m
    assert np.allclose(scene.dome.axis, towards / np.linalg.norm(towards), atol=1e-6)
    assert cell_config.CellConfig.model_validate(cell.model_dump()).fingerprint == scene.fingerprint


@pytest.mark.parametrize(
    ("header", "current"),
    [('"a"', True), ('W/"a"', True), ('"b", "a"', True), ("*", True), ('"b"', False), ("a", False), ("", False)],
)
def test_is_current_compares_weakly(header: str, current: bool) -> None:
    assert is_current(header, '"a"') is current
    assert not is_current(header, "")


def _settings(path: Any, folder: Any) -> Any:
    return settings.read(cell=path, data=folder / "data", host="127.0.4.2", port=0)


def _outside(points: Any, capsule: Any) -> Any:
    start, end = np.array(capsule.start_m), np.array(capsule.end_m)
    axis = end - start
    share = np.clip((points - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
    return np.linalg.norm(points - start - share[:, None] * axis, axis=1) - capsule.radius_m
