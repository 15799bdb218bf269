"""Example of a SceneResource for the OpenAPI description: the simulated cell, with its links shortened."""

from api.rest.scene_schemas import (
    SceneArm,
    SceneCamera,
    SceneCapsule,
    SceneDome,
    SceneHalfSpaceBody,
    SceneJoint,
    SceneKeepOut,
    SceneLight,
    SceneLink,
    SceneResource,
    SceneTool,
)

_LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_ROWS = (
    (0.0, 0.1625, 1.5708), (-0.425, 0.0, 0.0), (-0.3922, 0.0, 0.0), (0.0, 0.1333, 1.5708), (0.0, 0.0997, -1.5708),
    (0.0, 0.0996, 0.0),
)  # fmt: skip
_BASE_FROM_CAMERA = ((1.0, 0.0, 0.0, 0.55), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
_BASE_FROM_VIEW = ((1.0, 0.0, 0.0, 0.55), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
_BASE_FROM_OBJECT = ((1.0, 0.0, 0.0, 0.55), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_TOOL = ((-0.26, 0.0, 0.97, 0.058), (0.0, 1.0, 0.0, 0.0), (-0.97, 0.0, -0.26, 0.1245), (0.0, 0.0, 0.0, 1.0))
_CAPSULE = SceneCapsule(start_m=(0.0, 0.0, 0.01), end_m=(0.0, 0.0, 0.14), radius_m=0.03)

SCENE = SceneResource(
    cell="simulated cell",
    fingerprint="9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
    base_from_view=_BASE_FROM_VIEW,
    arm=SceneArm(
        model="ur5e",
        kinematics="nominal",
        joints=[SceneJoint(theta_rad=0.0, a_m=a, d_m=d, alpha_rad=alpha) for a, d, alpha in _ROWS],
        links=[
            SceneLink(
                number=number,
                name=name,
                mesh=f"/v1/rig/scene/meshes/{name}-9f86d081884c7d65.stl",
                capsules=[_CAPSULE],
            )
            for number, name in enumerate(_LINKS)
        ],
        home=(3.14, -1.6, 1.8, -1.77, -1.57, 1.57),
        joint_limit_rad=6.233,
        elbow_limit_rad=3.092,
    ),
    tool=SceneTool(
        flange_from_tool=_TOOL,
        flange_from_lamp=_TOOL,
        capsules=[_CAPSULE],
        cable_allowance_m=0.0,
        lobe_exponent=1.0,
    ),
    camera=SceneCamera(
        base_from_camera=_BASE_FROM_CAMERA,
        width_px=1024,
        height_px=1024,
        camera_matrix=((4000.0, 0.0, 511.5), (0.0, 4000.0, 511.5), (0.0, 0.0, 1.0)),
        distortion=[0.0, 0.0, 0.0, 0.0, 0.0],
        object_depth_m=0.945,
        corners_m=[(0.43, 0.12, 0.055), (0.67, 0.12, 0.055), (0.67, -0.12, 0.055), (0.43, -0.12, 0.055)],
    ),
    keep_out=SceneKeepOut(base_from_object=_BASE_FROM_OBJECT, radius_m=0.085, height_m=0.11, clearance_m=0.03),
    bodies=[
        SceneHalfSpaceBody(
            name="table", role="table", clearance_m=0.02, point_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)
        )
    ],
    dome=SceneDome(
        center_m=(0.55, 0.0, 0.03), axis=(0.0, 0.0, 1.0), radius_m=0.45, min_slant_deg=8.0, max_slant_deg=75.0
    ),
    lights=[SceneLight(position=(0.12, 0.05, -0.57), refusal=None)],
    links={"self": "/v1/rig/scene", "reach": "/v1/rig/reach"},
)
