"""Routes of the cell's geometry: what a page needs to draw arm, lamp, object, obstacles, camera and dome in 3-D.

A client computes each link's pose from six joint angles, so a moving arm costs the service only the angles. Meshes have
their content's hash in their address and are cached for good. The description has an ETag, and changes when the reach
becomes known or another calibration comes into use.
"""

import hashlib
import json
import threading
from pathlib import Path
from typing import Annotated, Any

import anyio.to_thread
import numpy as np
from fastapi import APIRouter, Request
from fastapi import Path as InPath
from fastapi.responses import Response
from scipy.spatial import ConvexHull

from acquisition import geometry, lamp_pose
from acquisition.capture import region
from acquisition.models import stl
from acquisition.models.base import FloatArray, Vector3, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, CellConfig, Cone, ConvexMesh, HalfSpace, Obstacle
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import Refusal
from acquisition.waypoints import kinematics
from acquisition.waypoints.link_meshes import link_meshes
from api.rest import problems, stored_files
from api.rest.scene_schemas import (
    AnySceneBody,
    SceneArm,
    SceneBoxBody,
    SceneCamera,
    SceneCapsule,
    SceneCapsuleBody,
    SceneConeBody,
    SceneDome,
    SceneHalfSpaceBody,
    SceneJoint,
    SceneKeepOut,
    SceneLight,
    SceneLink,
    SceneMeshBody,
    SceneResource,
    SceneTool,
)
from api.rest.wiring import Service

MESHES = "/v1/rig/scene/meshes"
"""Path below which the meshes are served."""

HASH_DIGITS = 16
"""Number of digits of a mesh's SHA-256 in its address: 64 bits suffice to tell a dozen meshes apart."""


class CellScene:
    """The geometry of a service's cell, encoded once. Any thread may call its methods."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._lock = threading.Lock()
        self._scene: tuple[str, SceneResource] | None = None  # with the fingerprint of its calibration
        self._meshes: dict[str, bytes] = {}
        self._encoded: tuple[object, bytes] | None = None

    def encoded(self) -> bytes:
        """Returns the SceneResource as JSON, encoded anew when the reach becomes known or the calibration changes."""
        with self._lock:
            reach_file = self._service.runner.planning.reach_file
            stamp = (reach_file, _stamp(reach_file))
            if self._encoded is None or self._encoded[0] != stamp:
                scene = self._geometry().model_copy(update={"lights": _lights(reach_file)})
                self._encoded = (stamp, scene.model_dump_json().encode())
            return self._encoded[1]

    def mesh(self, name: str) -> bytes:
        """Returns a mesh by the last part of its address. Raises RigError request.not_found."""
        with self._lock:
            self._geometry()
        if name not in self._meshes:
            raise RigError(
                ErrorCode.REQUEST_NOT_FOUND, f"There is no mesh {name!r}; GET /v1/rig/scene lists the meshes"
            )
        return self._meshes[name]

    def _geometry(self) -> SceneResource:
        cell, calibration = self._service.cell, self._service.calibration
        if self._scene is None or self._scene[0] != calibration.fingerprint:
            scene = SceneResource(
                cell=cell.name,
                fingerprint=cell.fingerprint,
                base_from_view=as_matrix4(lamp_pose.base_from_view(calibration)),
                arm=self._arm(cell),
                tool=_tool(cell, calibration),
                camera=_camera(cell, calibration),
                keep_out=_keep_out(cell),
                bodies=self._bodies(cell),
                dome=_dome(cell, calibration),
                lights=None,
                links={
                    "self": "/v1/rig/scene",
                    "reach": "/v1/rig/reach",
                    "rig": "/v1/rig",
                    "events": "/v1/events?joints=true",
                },
            )
            self._scene = (calibration.fingerprint, scene)
        return self._scene[1]

    def _arm(self, cell: CellConfig) -> SceneArm:
        model = kinematics.arm_model(cell.arm.model)
        calibrated = cell.arm.kinematics
        rows = (
            kinematics.denavit_hartenberg(model)
            if calibrated is None
            else [(joint.theta_rad, joint.a_m, joint.d_m, joint.alpha_rad) for joint in calibrated]
        )
        links = [
            SceneLink(
                number=mesh.link,
                name=mesh.name,
                mesh=self._add_mesh(mesh.name, stl.encoded(mesh.vertices, mesh.faces)),
                capsules=[
                    SceneCapsule(start_m=_vector(row[:3]), end_m=_vector(row[3:6]), radius_m=float(row[6]))
                    for link, row in zip(model.capsule_links, model.capsules, strict=True)
                    if link == mesh.link
                ],
            )
            for mesh in link_meshes(cell.arm.model)
        ]
        return SceneArm(
            model=cell.arm.model,
            kinematics="nominal" if calibrated is None else "calibrated",
            joints=[SceneJoint(theta_rad=row[0], a_m=row[1], d_m=row[2], alpha_rad=row[3]) for row in rows],
            links=links,
            home=cell.arm.home,
            joint_limit_rad=kinematics.JOINT_LIMIT,
            elbow_limit_rad=kinematics.ELBOW_LIMIT,
        )

    def _bodies(self, cell: CellConfig) -> list[AnySceneBody]:
        usual = cell.clearances.obstacle_m
        return [
            self._body(cell.table, "table", cell.clearances.table_m),
            *(self._body(item, "camera", usual) for item in cell.camera_body),
            *(self._body(item, "obstacle", usual) for item in cell.obstacles),
        ]

    def _body(self, item: Obstacle, role: str, usual_m: float) -> AnySceneBody:
        own: dict[str, Any] = {
            "name": item.name,
            "role": role,
            "clearance_m": usual_m if item.clearance_m is None else item.clearance_m,
        }
        match item:
            case HalfSpace():
                normal = np.array(item.normal) / np.linalg.norm(item.normal)
                return SceneHalfSpaceBody(**own, point_m=item.point_m, normal=_vector(normal))
            case Box():
                pose = as_matrix4(item.base_from_box.matrix)
                return SceneBoxBody(**own, base_from_box=pose, half_extents_m=item.half_extents_m)
            case Capsule():
                return SceneCapsuleBody(**own, **_capsule(item).model_dump())
            case Cone():
                return SceneConeBody(
                    **own,
                    base_from_cone=as_matrix4(item.base_from_cone.matrix),
                    foot_radius_m=item.foot_radius_m,
                    top_radius_m=item.top_radius_m,
                    height_m=item.height_m,
                )
            case ConvexMesh():
                return SceneMeshBody(**own, mesh=self._add_mesh("hull", _hull(item)))

    def _add_mesh(self, name: str, content: bytes) -> str:
        """Keeps a mesh and returns its address, which contains its hash."""
        name = f"{name}-{hashlib.sha256(content).hexdigest()[:HASH_DIGITS]}.stl"
        self._meshes[name] = content
        return f"{MESHES}/{name}"


def _tool(cell: CellConfig, calibration: Calibration) -> SceneTool:
    flange_from_tool = cell.arm.flange_from_tool.matrix
    return SceneTool(
        flange_from_tool=as_matrix4(flange_from_tool),
        flange_from_lamp=as_matrix4(flange_from_tool @ np.array(calibration.tool_from_lamp)),
        capsules=[_capsule(capsule) for capsule in cell.arm.tool_capsules],
        cable_allowance_m=cell.arm.cable_allowance_m,
        lobe_exponent=calibration.lobe_exponent,
    )


def _camera(cell: CellConfig, calibration: Calibration) -> SceneCamera:
    depth = region.middle_depth_m(cell, calibration)
    right, bottom = calibration.width - 0.5, calibration.height - 0.5  # px: the middle of the first pixel is 0
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays = geometry.undistorted(corners, calibration.camera_matrix, calibration.distortion)
    points = depth * np.column_stack([rays, np.ones(4)])
    return SceneCamera(
        base_from_camera=calibration.base_from_camera,
        width_px=calibration.width,
        height_px=calibration.height,
        camera_matrix=calibration.camera_matrix,
        distortion=list(calibration.distortion),
        object_depth_m=depth,
        corners_m=[_vector(point) for point in geometry.transform(np.array(calibration.base_from_camera), points)],
    )


def _keep_out(cell: CellConfig) -> SceneKeepOut:
    cylinder = cell.object.keep_out
    return SceneKeepOut(
        base_from_object=as_matrix4(cylinder.base_from_object.matrix),
        radius_m=cylinder.radius_m,
        height_m=cylinder.height_m,
        clearance_m=cell.clearances.object_m,
    )


def _dome(cell: CellConfig, calibration: Calibration) -> SceneDome:
    center = geometry.transform(cell.object.keep_out.base_from_object.matrix, cell.dome.center_m)
    return SceneDome(
        center_m=_vector(center),
        axis=_vector(lamp_pose.base_from_view(calibration)[:3, 2]),
        radius_m=cell.dome.radius_m,
        min_slant_deg=cell.dome.min_slant_deg,
        max_slant_deg=cell.dome.max_slant_deg,
    )


def _lights(reach_file: Path) -> list[SceneLight] | None:
    """Reads the candidates of a stored ReachMap as plain JSON, because its class would load the planner's kernels."""
    if not reach_file.exists():
        return None
    stored = json.loads(stored_files.read_bytes(reach_file))
    return [
        SceneLight(
            position=_vector(np.array(point)), refusal=None if refusal is None else Refusal.model_validate(refusal)
        )
        for point, refusal in zip(stored["points"], stored["refusals"], strict=True)
    ]


def _hull(item: ConvexMesh) -> bytes:
    """Returns the convex hull of a mesh's vertices as binary STL, faces outwards, in the base frame."""
    points = geometry.transform(item.base_from_mesh.matrix, np.array(item.vertices_m))
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.sum(normals * hull.equations[:, :3], axis=1) < 0
    faces = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
    return stl.encoded(points, faces)


def _capsule(capsule: CapsuleShape | Capsule) -> SceneCapsule:
    return SceneCapsule(start_m=capsule.start_m, end_m=capsule.end_m, radius_m=capsule.radius_m)


def _vector(values: FloatArray) -> Vector3:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _stamp(file: Path) -> tuple[int, int] | None:
    try:
        status = file.stat()
    except FileNotFoundError:
        return None
    return status.st_mtime_ns, status.st_ino


router = APIRouter(tags=["rig"])


@router.get("/v1/rig/scene", response_model=SceneResource, responses=stored_files.NOT_MODIFIED)
async def scene(request: Request) -> Response:
    """Returns the cell's geometry for a 3-D view: arm, tool, camera, object, bodies, dome and lights, with all frames.

    It changes when the reach becomes known or another calibration comes into use; until then its ETag saves the
    transfer.
    """
    cell_scene: CellScene = request.app.state.scene
    content = await anyio.to_thread.run_sync(cell_scene.encoded)
    headers = stored_files.revalidated(hashlib.sha256(content).hexdigest())
    return Response(content, media_type="application/json", headers=headers)


@router.get(
    MESHES + "/{name}",
    response_class=Response,
    responses={
        **stored_files.binary("model/stl", description="The surface: binary STL, m, link frame"),
        **stored_files.NOT_MODIFIED,
        **problems.responses_of(ErrorCode.REQUEST_NOT_FOUND),
    },
)
async def scene_mesh(
    request: Request,
    name: Annotated[str, InPath(max_length=100, description="Last part of an address that the scene holds")],
) -> Response:
    """Returns a surface of the cell: binary STL, m, in the frame that the scene states; its address holds its hash."""
    cell_scene: CellScene = request.app.state.scene
    content = await anyio.to_thread.run_sync(cell_scene.mesh, name)
    return Response(content, media_type="model/stl", headers=stored_files.immutable(name.removesuffix(".stl")))
