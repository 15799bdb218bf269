"""Configuration of a cell, read from a TOML file into frozen models. An unknown or missing field rejects the file.

Deployment settings (host, port, data folder) are not properties of the cell; they come from the environment.
"""

import hashlib
import json
import math
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from acquisition import geometry
from acquisition.models import stl
from acquisition.models.base import Joints, Value, Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.camera_config import AnyCamera
from acquisition.models.charuco_markers import refuse_too_many_squares
from acquisition.models.errors import ErrorCode, RigError, wrong_fields


class Pose(Value):
    """A rigid transform: position in m, rotation vector in rad."""

    position_m: Vector3
    rotation_vector_rad: Vector3 = (0.0, 0.0, 0.0)

    @field_validator("rotation_vector_rad")
    @classmethod
    def _is_in_rad(cls, vector: Vector3) -> Vector3:
        """Refuses more than a turn, which is in degrees."""
        if math.hypot(*vector) > 2 * math.pi:
            raise ValueError("the vector is longer than a turn: it is the axis times the angle in rad, not in degrees")
        return vector

    @property
    def matrix(self) -> geometry.FloatArray:
        """The homogeneous matrix (4, 4)."""
        return geometry.pose(self.position_m, self.rotation_vector_rad)


class CapsuleShape(Value):
    """All points within `radius_m` of the segment from `start_m` to `end_m`."""

    start_m: Vector3
    end_m: Vector3
    radius_m: float = Field(gt=0)


class JointGeometry(Value):
    """Denavit–Hartenberg parameters of one joint from the arm's factory calibration."""

    theta_rad: float
    a_m: float
    d_m: float
    alpha_rad: float


Tool = Literal["lamp", "board"]
"""What is on the arm's flange: the lamp, or the ChArUco board of the cell file."""


class BoardConfig(Value):
    """A ChArUco board on the flange, for calibration sessions. Its frame has its origin at the upper left corner of the
    squares, x along the columns, y along the rows and z into the board."""

    columns: int = Field(ge=3, le=40, description="Squares along x")
    rows: int = Field(ge=3, le=40, description="Squares along y")
    square_m: float = Field(gt=0.001, lt=0.5, description="Side of a square as measured on the print")
    marker_share: float = Field(default=0.75, ge=0.4, le=0.9, description="Side of a marker / side of a square")
    legacy_pattern: bool = Field(default=False, description="Pattern of OpenCV before 4.6 and of calib.io")
    flange_from_board: Pose = Field(description="Accurate to a few millimetres: a calibration refines it")
    margin_m: float = Field(default=0.01, ge=0, description="Width of the plate beyond the squares, on each side")
    thickness_m: float = Field(default=0.005, gt=0, description="Thickness of the plate, behind its printed face")
    bracket_capsules: list[CapsuleShape] = Field(
        default_factory=list[CapsuleShape], description="What holds it, in the flange frame"
    )
    replaces_lamp: bool = Field(
        default=True,
        description="Whether the board takes the lamp's place on the flange; false: it is mounted beside the lamp",
    )
    payload_kg: float | None = Field(
        default=None,
        gt=0,
        description="All that is on the flange with the board, bracket and lamp included; none: as `arm.payload_kg`",
    )
    payload_center_m: Vector3 | None = Field(
        default=None, description="Centre of gravity of that, in the flange frame; stated together with `payload_kg`"
    )

    @model_validator(mode="after")
    def _markers_suffice(self) -> "BoardConfig":
        refuse_too_many_squares(self.columns, self.rows)
        return self

    @model_validator(mode="after")
    def _payload_is_whole(self) -> "BoardConfig":
        """Refuses a mass without a centre of gravity, and the other way round."""
        if (self.payload_kg is None) != (self.payload_center_m is None):
            raise ValueError("payload_kg and payload_center_m belong together: state both, or neither")
        return self


class LampTargetsConfig(Value):
    """Targets of a lamp calibration, in the object's place: a mirror sphere, and a matt plane in a ChArUco frame."""

    sphere_radius_m: float = Field(
        ge=0.001, le=0.2, description="As stamped on a bearing ball, or measured with a calliper"
    )
    window_radius_m: float = Field(
        default=0.0, ge=0, le=0.2, description="Radius of the lamp's luminous window, across its axis; 0: a point"
    )
    columns: int = Field(ge=3, le=40, description="The plane: squares along x, its blank middle included")
    rows: int = Field(ge=3, le=40, description="Squares along y")
    square_m: float = Field(gt=0.001, lt=0.5, description="Side of a square as measured on the print")
    border_squares: int = Field(ge=1, le=10, description="Squares of the frame round the blank, matt middle")
    marker_share: float = Field(default=0.75, ge=0.4, le=0.9, description="Side of a marker / side of a square")
    legacy_pattern: bool = Field(default=False, description="Pattern of OpenCV before 4.6 and of calib.io")
    albedo: float = Field(ge=0.05, le=1, description="Reflectance of the blank middle: office paper has 0.85")
    albedo_sigma: float = Field(default=0.01, ge=0, le=0.5, description="1 σ of that, as a fraction")

    @model_validator(mode="after")
    def _markers_suffice(self) -> "LampTargetsConfig":
        refuse_too_many_squares(self.columns, self.rows)
        return self


class GreyTileConfig(Value):
    """A uniform matt tile that shows the lamp's brightness in each image. It lies flat on the table in the picture,
    beside the object and out of its shadows."""

    outline_px: list[tuple[float, float]] = Field(
        min_length=3, max_length=32, description="Its corners in the image, in their order: column and row"
    )
    height_m: float = Field(default=0.003, ge=0, le=0.2, description="Height of its face over the table")


class ArmConfig(Value):
    """The arm, its tool and its limits."""

    kind: Literal["ur"] = "ur"
    model: Literal["ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur15", "ur16e", "ur20", "ur30"]
    address: str
    polyscope: Literal["5", "x"] = Field(
        default="5", description="Software of the controller: PolyScope 5, or X, which has no dashboard; checked"
    )
    robot_api_port: int = Field(default=80, gt=0, lt=65536, description="PolyScope X: the port of its Robot API")
    serial: str | None = Field(default=None, description="Checked at connection when given")
    flange_from_tool: Pose = Field(description="The controller's TCP: origin at the emitter, +z the lamp's axis")
    payload_kg: float = Field(gt=0, description="Bracket, lamp and cable, weighed")
    payload_center_m: Vector3 = Field(description="Their centre of gravity in the flange frame")
    tool_capsules: list[CapsuleShape] = Field(min_length=1, description="Bracket and lamp, in the flange frame")
    cable_allowance_m: float = Field(
        default=0.0, ge=0, description="Added to the radius of the last wrist and the tool for cables"
    )
    home: Joints = Field(description="Joint angles, rad: clear of the camera's view, near the middle of the lights")
    max_joint_speed_rad_s: float = Field(default=1.05, gt=0, le=math.pi)
    max_joint_acceleration_rad_s2: float = Field(default=1.4, gt=0, le=40)
    max_tool_speed_m_s: float = Field(default=0.25, gt=0, le=3)
    max_elbow_speed_m_s: float = Field(default=0.5, gt=0, le=3)
    stop_deceleration_rad_s2: float = Field(
        default=6.0,
        gt=0,
        le=40,
        description="Must stop the arm from its maximum speed within 0.2 s, the watchdog's timeout",
    )
    settle_s: float = Field(default=0.25, ge=0, description="From standstill until the lamp no longer swings")
    remote_recovery: bool = Field(
        default=False, description="Whether an operator may unlock, power on and release brakes over HTTP"
    )
    nominal_kinematics_tolerance_m: float = Field(default=0.003, gt=0)
    tool: Tool = Field(
        default="lamp", description="What is on the flange until somebody states otherwise (PUT /v1/rig/tool)"
    )
    kinematics: list[JointGeometry] | None = Field(
        default=None,
        min_length=6,
        max_length=6,
        description="Factory-calibrated kinematics, for poses accurate to 0.1 mm; `lightpose check` prints it",
    )

    @field_validator("home")
    @classmethod
    def _is_in_rad(cls, home: Joints) -> Joints:
        """Refuses angles that no joint can reach: they are in degrees."""
        if max(map(abs, home)) > 2 * math.pi:
            raise ValueError("angles are in rad, between -2π and 2π")
        return home


class LampConfig(Value):
    """Digital output of the controller that switches the lamp (0–7 standard, 8–15 configurable, 16–17 tool)."""

    kind: Literal["ur-output"] = "ur-output"
    output: int = Field(ge=0, le=17)
    rise_s: float = Field(default=0.02, ge=0, description="Delay between the confirmed output and the exposure")


class KeepOut(Value):
    """A cylinder that encloses the object: foot at the origin of its frame, axis along +z. No margin shrinks it."""

    radius_m: float = Field(gt=0)
    height_m: float = Field(gt=0)
    base_from_object: Pose


class ObjectConfig(Value):
    """The object's keep-out volume."""

    keep_out: KeepOut


MIN_SLANT_DEG, MAX_SLANT_DEG = 8.0, 75.0
"""Usual limits of a dome's slants. Nearer to the view axis, lamps are in the picture; beyond, they graze the table."""


class DomeConfig(Value):
    """Dome of light positions: a spherical cap about `center_m` (object frame). Slants are angles to the view axis."""

    center_m: Vector3 = Field(default=(0.0, 0.0, 0.03), description="In the object's frame, m")
    radius_m: float = Field(default=0.45, gt=0, description="Distance of the lights from there")
    min_slant_deg: float = Field(default=MIN_SLANT_DEG, ge=0)
    max_slant_deg: float = Field(default=MAX_SLANT_DEG, gt=0, le=89)
    candidates: int = Field(default=300, ge=12, le=2000)

    @model_validator(mode="after")
    def _is_a_cap(self) -> "DomeConfig":
        if self.min_slant_deg >= self.max_slant_deg:
            raise ValueError("min_slant_deg must be below max_slant_deg")
        return self


class ObstacleBase(Value):
    """Fields of all obstacles."""

    name: str
    clearance_m: float | None = Field(default=None, gt=0, description="Minimum distance; default: that of `clearances`")


LEAST_NORMAL = 1e-6
"""Minimum length of a half-space's normal. A shorter one has no direction, and nothing would collide with it."""


class HalfSpace(ObstacleBase):
    """A half-space: points x with normal · (x − point) < 0, base frame."""

    kind: Literal["half-space"] = "half-space"
    point_m: Vector3
    normal: Vector3 = Field(description="Out of the obstacle, of any length")

    @field_validator("normal")
    @classmethod
    def _has_a_direction(cls, normal: Vector3) -> Vector3:
        if np.linalg.norm(normal) < LEAST_NORMAL:
            raise ValueError("normal has no direction: give the one that points out of the obstacle, such as [0, 0, 1]")
        return normal


HalfExtent = Annotated[float, Field(gt=0)]


class Box(ObstacleBase):
    """A box with half extents, base frame."""

    kind: Literal["box"] = "box"
    base_from_box: Pose
    half_extents_m: Annotated[tuple[HalfExtent, HalfExtent, HalfExtent], Field(strict=False)]


class Capsule(ObstacleBase):
    """A capsule, base frame."""

    kind: Literal["capsule"] = "capsule"
    start_m: Vector3
    end_m: Vector3
    radius_m: float = Field(gt=0)


class Cone(ObstacleBase):
    """A right circular cone or frustum: from its foot along +z of its frame to its top; base frame."""

    kind: Literal["cone"] = "cone"
    base_from_cone: Pose
    foot_radius_m: float = Field(ge=0)
    top_radius_m: float = Field(default=0.0, ge=0)
    height_m: float = Field(gt=0)


FLAT_M = 1e-6
"""Smallest singular value of the centred vertices, m, below which they are coplanar within rounding."""


class ConvexMesh(ObstacleBase):
    """The convex hull of vertices in a frame of its own.

    Instead of the vertices, a cell file may name an STL file (`file`, relative to the cell file, in m). Its vertices
    are read together with the cell, so that the loaded cell is self-contained.
    """

    kind: Literal["convex-mesh"] = "convex-mesh"
    base_from_mesh: Pose
    vertices_m: list[Vector3] = Field(min_length=4, max_length=20_000)

    @field_validator("vertices_m")
    @classmethod
    def _has_a_volume(cls, vertices_m: list[Vector3]) -> list[Vector3]:
        spread = np.array(vertices_m) - np.mean(vertices_m, axis=0)
        if np.linalg.svd(spread, compute_uv=False)[-1] < FLAT_M:
            raise ValueError("the vertices lie in a plane and enclose nothing: use a thin box instead")
        return vertices_m


Obstacle = Annotated[HalfSpace | Box | Capsule | Cone | ConvexMesh, Field(discriminator="kind")]


class Clearances(Value):
    """Default minimum distances of the arm."""

    table_m: float = Field(default=0.02, gt=0)
    object_m: float = Field(default=0.03, gt=0)
    obstacle_m: float = Field(default=0.03, gt=0)
    self_m: float = Field(default=0.01, gt=0)


_LATER_FIELDS = (
    ("arm", "polyscope"), ("arm", "robot_api_port"), ("arm", "tool"), ("board", "payload_kg"),
    ("board", "payload_center_m"), ("board",), ("lamp_targets",), ("grey_tile",), ("camera", "reconnect_s"),
)  # fmt: skip
"""Fields that cells of recorded sessions may lack. The default of each is the behaviour without the field."""


class CellConfig(Value):
    """Configuration of a cell; `load` reads it from TOML."""

    name: str
    calibration: str = Field(description="Path of calibration.json, relative to the cell file")
    arm: ArmConfig
    lamp: LampConfig
    camera: AnyCamera
    object: ObjectConfig
    dome: DomeConfig = DomeConfig()
    table: HalfSpace
    camera_body: list[Capsule] = Field(description="The camera and its lens, base frame")
    obstacles: list[Obstacle] = Field(default_factory=list[HalfSpace | Box | Capsule | Cone | ConvexMesh])
    clearances: Clearances = Clearances()
    board: BoardConfig | None = Field(
        default=None, description="The board of calibration sessions; none: there is none"
    )
    lamp_targets: LampTargetsConfig | None = Field(
        default=None, description="Sphere and plane of calibration sessions of the lamp; none: there are none"
    )
    grey_tile: GreyTileConfig | None = Field(
        default=None, description="A tile in the picture that gives each image's intensity; none: there is none"
    )

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the cell's values. Comments and spaces in the file do not change it, nor do `_LATER_FIELDS` at
        their defaults, so that an interrupted session can be resumed after an upgrade."""
        values = self.model_dump(mode="json")
        for *sections, name in _LATER_FIELDS:
            owner: Value | None = self
            section = values
            for part in sections:
                owner, section = getattr(owner, part), section[part]
            if owner is not None and getattr(owner, name) == type(owner).model_fields[name].default:
                del section[name]
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def load(path: Path) -> CellConfig:
    """Reads a cell file. Raises RigError config.invalid naming the file and each invalid field."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        stl.read_meshes(content, path)
        return CellConfig.model_validate_json(json.dumps(content))
    except OSError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: cannot be read: {error.strerror}", file=str(path)) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: is not TOML: {error}", file=str(path)) from error
    except ValidationError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: {wrong_fields(error)}", file=str(path)) from error


def load_calibration(path: Path) -> Calibration:
    """Reads `calibration.json`. Raises RigError config.invalid naming the file and each invalid field."""
    try:
        return Calibration.model_validate_json(path.read_bytes())
    except OSError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: cannot be read: {error.strerror}", file=str(path)) from error
    except ValidationError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: {wrong_fields(error)}", file=str(path)) from error
