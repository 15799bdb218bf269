"""Schemas of the cell's geometry for a three-dimensional view: arm, tool, camera, object, obstacles, dome, lights.

Every pose is a homogeneous matrix `a_from_b`, row by row, which maps points of frame b to frame a. Frames: `base`, the
arm's; `link`, the Denavit–Hartenberg frame after a joint (link 0 is the base); `flange`, link 6; `lamp`, at the emitter
with +z along the beam; `camera`, OpenCV's (x right, y down, z forward); `view`, with the camera's origin (x right, y
up, z to the camera). Lights are given in the view frame everywhere in this API.
"""

from typing import Annotated, Literal

from pydantic import Field

from acquisition.models.base import Joints, Matrix4, Vector3
from acquisition.models.route import Refusal
from api.rest.schemas import Links, Resource


class SceneCapsule(Resource):
    """All points within `radius_m` of a segment."""

    start_m: Vector3 = Field(description="Start of the segment, m")
    end_m: Vector3 = Field(description="End of the segment, m")
    radius_m: float = Field(gt=0, description="Radius about the segment, m")


class SceneJoint(Resource):
    """Denavit–Hartenberg row of one joint: link i − 1 from link i is Rz(q + theta) · Tz(d) · Tx(a) · Rx(alpha)."""

    theta_rad: float = Field(description="Added to the joint's angle q, rad; 0 in the nominal arm")
    a_m: float = Field(description="Translation along the new x axis, m")
    d_m: float = Field(description="Translation along the joint's axis, m")
    alpha_rad: float = Field(description="Rotation about the new x axis, rad")


class SceneLink(Resource):
    """One link of the arm. Its mesh and its capsules are in the link's own frame."""

    number: int = Field(ge=0, le=6, description="0: the base, which stands still; 6: the flange's link")
    name: str = Field(description="The maker's name of the link, such as `upper_arm`")
    mesh: str = Field(description="Address of the link's surface: binary STL, m, link frame; immutable")
    capsules: list[SceneCapsule] = Field(
        description="Shapes that collisions are checked with; they enclose the mesh; link frame"
    )


class SceneArm(Resource):
    """The arm: kinematic chain, links, limits. Pose of link i: the product of the first i joints' transforms."""

    model: str = Field(description="Model of the arm, such as `ur5e`")
    kinematics: Literal["nominal", "calibrated"] = Field(
        description="Whether the chain is the maker's nominal one or this arm's own from the cell file"
    )
    joints: list[SceneJoint] = Field(min_length=6, max_length=6, description="The six joints, from the base on")
    links: list[SceneLink] = Field(min_length=7, max_length=7, description="Links 0 (base) to 6 (flange)")
    home: Joints = Field(description="Joint angles of the home position, rad")
    joint_limit_rad: float = Field(description="Limit of every joint, ± rad, that paths keep")
    elbow_limit_rad: float = Field(description="Limit of the elbow (the third joint), ± rad")


class SceneTool(Resource):
    """Bracket and lamp at the flange."""

    flange_from_tool: Matrix4 = Field(description="Pose of the controller's tool frame (TCP) in the flange frame; m")
    flange_from_lamp: Matrix4 = Field(description="Pose of the lamp in the flange frame: emitter, +z the beam; m")
    capsules: list[SceneCapsule] = Field(description="Bracket and lamp as the cell file has them; flange frame")
    cable_allowance_m: float = Field(description="What collision checks add to these radii and link 6's for cables, m")
    lobe_exponent: float = Field(description="The lamp's intensity falls off its axis as cos to this power; no unit")


class SceneCamera(Resource):
    """The camera's pose, its intrinsics, and what it sees at the depth of the object."""

    base_from_camera: Matrix4 = Field(description="Pose of the camera (OpenCV axes: z forward) in the base frame; m")
    width_px: int = Field(description="Width of its images, px")
    height_px: int = Field(description="Height of its images, px")
    camera_matrix: tuple[Vector3, Vector3, Vector3] = Field(description="Intrinsic matrix, px")
    distortion: list[float] = Field(description="OpenCV's coefficients k1, k2, p1, p2, k3; no unit")
    object_depth_m: float = Field(description="Depth of the middle of the keep-out along the camera's z, m")
    corners_m: list[Vector3] = Field(
        min_length=4,
        max_length=4,
        description="Where the rays through the image's corners (top left, top right, bottom right, bottom left; lens "
        "distortion undone) reach that depth; base frame, m",
    )


class SceneKeepOut(Resource):
    """The keep-out: a cylinder that encloses the object, from the origin of its frame along +z."""

    base_from_object: Matrix4 = Field(description="Pose of the object's frame in the base frame; m")
    radius_m: float = Field(description="Radius, m")
    height_m: float = Field(description="Height, m")
    clearance_m: float = Field(description="Distance that the arm keeps from it, m")


class SceneBody(Resource):
    """Base of all bodies of a cell."""

    name: str = Field(description="Its name in the cell file")
    role: Literal["table", "camera", "obstacle"] = Field(description="What it is")
    clearance_m: float = Field(description="Distance that the arm keeps from it, m")


class SceneHalfSpaceBody(SceneBody):
    """A half-space, such as a table below its top: all points x with normal · (x − point) < 0."""

    kind: Literal["half-space"] = Field(default="half-space", description="Tells the shapes apart")
    point_m: Vector3 = Field(description="A point of its surface; base frame, m")
    normal: Vector3 = Field(description="Unit vector out of it; base frame")


class SceneBoxBody(SceneBody):
    """A box centred on the origin of its frame."""

    kind: Literal["box"] = Field(default="box", description="Tells the shapes apart")
    base_from_box: Matrix4 = Field(description="Pose of its centre in the base frame; m")
    half_extents_m: Vector3 = Field(description="Half of its lengths along its axes, m")


class SceneCapsuleBody(SceneBody, SceneCapsule):
    """A capsule in the base frame."""

    kind: Literal["capsule"] = Field(default="capsule", description="Tells the shapes apart")


class SceneConeBody(SceneBody):
    """A right circular cone or frustum from its foot along +z of its frame."""

    kind: Literal["cone"] = Field(default="cone", description="Tells the shapes apart")
    base_from_cone: Matrix4 = Field(description="Pose of the middle of its foot in the base frame; m")
    foot_radius_m: float = Field(description="Radius of the foot, m")
    top_radius_m: float = Field(description="Radius of the top, m; 0: a cone")
    height_m: float = Field(description="Height, m")


class SceneMeshBody(SceneBody):
    """The convex hull of a mesh of the cell file."""

    kind: Literal["mesh"] = Field(default="mesh", description="Tells the shapes apart")
    mesh: str = Field(description="Address of the hull's surface: binary STL, m, base frame; immutable")


AnySceneBody = Annotated[
    SceneHalfSpaceBody | SceneBoxBody | SceneCapsuleBody | SceneConeBody | SceneMeshBody, Field(discriminator="kind")
]


class SceneDome(Resource):
    """The dome on which lights may stand: a cap of a sphere about `center_m`, with slants from the camera's axis."""

    center_m: Vector3 = Field(description="Centre, towards which every lamp looks; base frame, m")
    axis: Vector3 = Field(description="Unit vector from the centre towards the camera, along its axis; base frame")
    radius_m: float = Field(description="Radius, m")
    min_slant_deg: float = Field(description="Smallest angle between a light's direction and the axis, degrees")
    max_slant_deg: float = Field(description="Largest angle between a light's direction and the axis, degrees")


class SceneLight(Resource):
    """One candidate position of the lamp on the dome."""

    position: Vector3 = Field(description="Position of the emitter; view frame, m")
    refusal: Refusal | None = Field(description="Why the arm does not serve it; null: it does")


class SceneResource(Resource):
    """The cell's geometry for a three-dimensional view; all lengths in m, all joint angles in rad."""

    cell: str = Field(description="Name of the cell")
    fingerprint: str = Field(description="SHA-256 of the cell file's values")
    base_from_view: Matrix4 = Field(
        description="Pose of the view frame, in which lights are given, in the base frame; m"
    )
    arm: SceneArm = Field(description="Kinematic chain and links")
    tool: SceneTool = Field(description="Bracket and lamp")
    camera: SceneCamera = Field(description="Pose, intrinsics and frustum")
    keep_out: SceneKeepOut = Field(description="The volume that the object may fill")
    bodies: list[AnySceneBody] = Field(description="Table, camera and obstacles")
    dome: SceneDome = Field(description="Where lights may stand")
    lights: list[SceneLight] | None = Field(
        description="Candidate lights on the dome; null until the reach has been computed (link `reach` does that)"
    )
    links: Links = Field(description="Addresses: `self`, `reach`, `rig`, `events`")
