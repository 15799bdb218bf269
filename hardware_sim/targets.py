"""Calibration targets of the simulated cell: ChArUco board, mirror sphere, matt plane, grey tile, on table or flange.

A target is chosen by name, like an object: `charuco`, `mirror-sphere`, `matt-plane`, `grey-tile`, or `empty` for the
table alone. The suffix `@flange` screws it to the arm's flange; `#N` is the N-th way in which an operator lays it on
the table (0: flat; others tilted, on a wedge). Targets are as the cell file describes them, or else as this module
does. The operator knows only nominal values: the print comes out larger or smaller, the board warps, the ball differs a
little from its stamped size, and nobody has measured where it lies.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

import numpy as np

from acquisition import geometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import sheets
from hardware_sim.charuco_print import CharucoPrint
from hardware_sim.objects import SceneObject
from hardware_sim.sheets import Mesh

Kind = Literal["charuco", "mirror-sphere", "matt-plane", "grey-tile", "empty"]
Mount = Literal["table", "flange"]

BOARD = CharucoPrint(columns=9, rows=7, square_m=0.010)
"""The board as ordered from the printer."""

PLANE = CharucoPrint(columns=12, rows=10, square_m=0.009, border_squares=2)
"""The matt plane: two squares of ChArUco round a blank middle of 72 × 54 mm."""

SPHERE_RADIUS_M, SPHERE_REFLECTANCE = 0.025, 0.6
"""A polished ball of bearing steel, 50 mm."""

TILE_SIDE_M, TILE_ALBEDO = 0.030, 0.18
"""A grey tile of 30 mm."""

FLANGE_PLACE_M, FLANGE_TURN_RAD = (-0.058, 0.0, 0.155), float(np.radians(105))
"""Position of a target's middle on the flange, m, and its turn about the flange's y, rad: on the back of the default
cell's lamp, so that it faces the camera while the lamp points down."""

SCALE_SIGMA, WARP_SIGMA_M, TWIST_SIGMA_M, RADIUS_SIGMA_M = 3e-4, 2e-4, 3e-5, 1e-5
"""1 σ of the print's scale, of a board's sag along either side and its twist, and of the ball's radius."""

MOUNT_SIGMA_M, MOUNT_SIGMA_RAD = 0.002, 0.02
"""1 σ of the deviation of a target's pose on the flange."""

LAID_OFF_M = 0.004
"""Greatest distance, m, along each axis at which an operator lays a target from the middle of the object's place."""

WEDGE_RAD = (float(np.radians(10)), float(np.radians(20)))
"""Range of the tilt, rad, of a target on a wedge."""

MARGIN_SQUARES, THICKNESS_M, ABOVE_TABLE_M, BACK_ALBEDO = 0.5, 0.002, 0.003, 0.05
"""Paper round the squares, in squares; a board's thickness, its height above the table, and the albedo of its back."""

GRID = 24
"""Number of cells along a board's sides: the facets follow its sag to within a micrometre."""


@dataclass(frozen=True)
class Nominal:
    """Targets as an operator knows them: prints, pose (4, 4) of the board on the flange, radius of the ball, m."""

    board: CharucoPrint
    flange_from_board: FloatArray
    plane: CharucoPrint
    sphere_radius_m: float


def nominal_of(cell: CellConfig) -> Nominal:
    """The targets of a cell file; those that it does not describe have this module's values."""
    board, flange_from_board, plane, radius_m = BOARD, _back_of_lamp(), PLANE, SPHERE_RADIUS_M
    if cell.board is not None:
        known = cell.board
        board = CharucoPrint(
            known.columns, known.rows, known.square_m, known.marker_share, legacy_pattern=known.legacy_pattern
        )
        flange_from_board = np.asarray(known.flange_from_board.matrix)
    if cell.lamp_targets is not None:
        known = cell.lamp_targets
        plane = CharucoPrint(
            known.columns, known.rows, known.square_m, known.marker_share, border_squares=known.border_squares,
            legacy_pattern=known.legacy_pattern, paper_albedo=known.albedo,
        )  # fmt: skip
        radius_m = known.sphere_radius_m
    return Nominal(board, flange_from_board, plane, radius_m)


_NAME = re.compile(r"(?P<kind>[a-z-]+)(@(?P<mount>[a-z]+))?(#(?P<placing>\d{1,6}))?")


@dataclass(frozen=True)
class TargetSpec:
    """A target's kind, its mount, and the number of its placing."""

    kind: Kind
    mount: Mount = "table"
    placing: int = 0

    def __str__(self) -> str:
        """As `parse` reads it."""
        return f"{self.kind}{'@flange' * (self.mount == 'flange')}{f'#{self.placing}' * (self.placing > 0)}"


@dataclass(frozen=True)
class Target:
    """A target: surface in its own frame, pose (4, 4) in its mount's frame (the object's or the flange's), reflectance
    of a mirror or 0, and facts for grading."""

    spec: TargetSpec
    surface: SceneObject
    mount_from_target: FloatArray
    mirror: float
    facts: dict[str, Any]

    def posed(self, object_from_mount: FloatArray) -> SceneObject:
        """The surface in the object's frame."""
        pose = object_from_mount @ self.mount_from_target
        back = geometry.inverse(pose)
        mesh = self.surface.mesh.transformed(pose[:3, :3], pose[:3, 3])
        texture = self.surface.texture
        return SceneObject(
            self.surface.name, mesh, lambda points: texture(geometry.transform(back, points.astype(float))), 0.0, 30.0
        )


def is_name(name: str) -> bool:
    """Whether a text names a kind of target; mount and placing may be invalid."""
    return re.split("[@#]", name)[0] in get_args(Kind)


def parse(name: str) -> TargetSpec:
    """Reads `charuco`, `matt-plane#2`, `charuco@flange`.

    Raises RigError request.invalid that lists the choices, or says what does not go together.
    """
    match = _NAME.fullmatch(name)
    kind, mount = (match["kind"], match["mount"] or "table") if match else ("", "")
    if match is None or kind not in get_args(Kind) or mount not in get_args(Mount):
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"there is no target {name!r}: choose one of {', '.join(get_args(Kind))}; append @flange to mount it on "
            "the flange, and #N for placing number N",
            object=name,
        )
    placing = int(match["placing"] or 0)
    if kind == "empty" and (mount == "flange" or placing):
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"{name}: empty is the table without a target, so there is nothing to mount or to lay down: write empty",
            object=name,
        )
    if mount == "flange" and placing:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"{name}: #N is a way to lay a target on the table, and on the flange there is one: write {kind}@flange",
            object=name,
        )
    return TargetSpec(cast(Kind, kind), cast(Mount, mount), placing)


def build(spec: TargetSpec, seed: int, nominal: Nominal) -> Target:
    """Makes a target; print and ball depend on the seed, but not on the placing."""
    random = np.random.default_rng([41, seed, sorted(get_args(Kind)).index(spec.kind)])
    surface, facts = _made(spec.kind, random, nominal)
    if spec.mount == "flange":
        pose = _on_flange(random, nominal.flange_from_board, np.array([*nominal.board.size_m, 0.0]) / 2, _middle(facts))
    else:
        pose = _on_table(spec, seed, surface, facts)
    mirror = SPHERE_REFLECTANCE if spec.kind == "mirror-sphere" else 0.0
    facts |= {"target": str(spec), f"{'flange' if spec.mount == 'flange' else 'object'}_from_target": pose.tolist()}
    return Target(spec, surface, pose, mirror, facts)


def _made(kind: Kind, random: np.random.Generator, nominal: Nominal) -> tuple[SceneObject, dict[str, Any]]:
    """Surface and facts of a target."""
    match kind:
        case "charuco":
            return _board(nominal.board, kind, random)
        case "matt-plane":
            return _board(nominal.plane, kind, random)
        case "mirror-sphere":
            return _ball(nominal.sphere_radius_m, random)
        case "grey-tile":
            return _tile()
        case "empty":
            return nothing(), {}


def nothing() -> SceneObject:
    """The table alone, as an object without a surface."""
    return SceneObject("empty", Mesh(np.zeros((0, 3, 3)), np.zeros((0, 3, 3))), _even(0.0), 0.0, 30.0)


def _board(made: CharucoPrint, name: str, random: np.random.Generator) -> tuple[SceneObject, dict[str, Any]]:
    scale = 1 + SCALE_SIGMA * random.standard_normal()
    warp, twist = WARP_SIGMA_M * random.standard_normal(2), TWIST_SIGMA_M * random.standard_normal()
    mesh = _warped(made, scale, warp, twist)

    def texture(points: FloatArray | Float32Array) -> Float32Array:
        front = made.albedo(points[:, :2] / scale)
        return np.where(points[:, 2] > THICKNESS_M / 2 + np.abs(warp).sum(), np.float32(BACK_ALBEDO), front)

    size = [scale * side for side in made.size_m]
    facts = {
        "square_scale": scale, "warp_m": warp.tolist(), "twist_m": twist, "albedo": made.paper_albedo, "size": size,
    }  # fmt: skip
    return SceneObject(name, mesh, texture, 0.0, 30.0), facts


def _warped(made: CharucoPrint, scale: float, warp: FloatArray, twist: float) -> Mesh:
    """A board's warped front and flat back; z points into the board, and the front faces −z."""
    margin = MARGIN_SQUARES * made.square_m
    (width, height) = made.size_m
    x, y = np.meshgrid(
        np.linspace(-margin, width + margin, GRID + 1), np.linspace(-margin, height + margin, GRID + 1), indexing="ij"
    )
    u, v = 2 * x / width - 1, 2 * y / height - 1
    z = warp[0] * (1 - u**2) + warp[1] * (1 - v**2) + twist * u * v
    slope_x = (-2 * warp[0] * u + twist * v) * 2 / width
    slope_y = (-2 * warp[1] * v + twist * u) * 2 / height
    front = sheets.sheet(
        np.stack([scale * x, scale * y, z], axis=-1), np.stack([slope_x, slope_y, -np.ones_like(x)], axis=-1)
    )
    behind = np.full_like(x, THICKNESS_M + 2 * np.abs(warp).sum())
    back = sheets.sheet(
        np.stack([scale * x, scale * y, behind], axis=-1), np.broadcast_to([0.0, 0.0, 1.0], (*x.shape, 3))
    )
    return sheets.joined([front, back])


def _ball(radius_m: float, random: np.random.Generator) -> tuple[SceneObject, dict[str, Any]]:
    radius = radius_m + RADIUS_SIGMA_M * random.standard_normal()
    mesh = sheets.joined([sheets.sheet(radius * unit, unit) for unit in sheets.cube_directions(96)])
    return SceneObject("mirror-sphere", mesh, _even(SPHERE_REFLECTANCE), 0.0, 30.0), {"radius_m": radius}


def _tile() -> tuple[SceneObject, dict[str, Any]]:
    side = TILE_SIDE_M
    mesh = sheets.quad((0, 0, 0), (0, side, 0), (side, side, 0), (side, 0, 0))  # its front faces −z
    facts = {"albedo": TILE_ALBEDO, "size": [side, side]}
    return SceneObject("grey-tile", mesh, _even(TILE_ALBEDO), 0.0, 30.0), facts


def _even(albedo: float) -> Callable[[FloatArray], FloatArray]:
    return lambda points: np.full(len(points), albedo)


def _middle(facts: dict[str, Any]) -> FloatArray:
    """A target's middle in its own frame."""
    return np.array([*facts["size"], 0.0]) / 2 if "size" in facts else np.zeros(3)


def _back_of_lamp() -> FloatArray:
    """Nominal pose (4, 4) of the board in the flange's frame if the cell file describes none: on the back of the lamp,
    z into the board, x along the flange's y."""
    across = geometry.pose((0.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2))
    pose = geometry.pose((0.0, 0.0, 0.0), (0.0, FLANGE_TURN_RAD, 0.0)) @ across
    pose[:3, 3] = np.array(FLANGE_PLACE_M) - pose[:3, :3] @ np.array([*BOARD.size_m, 0.0]) / 2
    return pose


def _on_flange(
    random: np.random.Generator, nominal: FloatArray, nominal_middle: FloatArray, middle: FloatArray
) -> FloatArray:
    """Pose (4, 4) with its middle at that of the board's nominal pose (4, 4), with the errors of screwing it on."""
    pose = nominal @ geometry.pose((0.0, 0.0, 0.0), MOUNT_SIGMA_RAD * random.standard_normal(3))
    place = geometry.transform(nominal, nominal_middle) + MOUNT_SIGMA_M * random.standard_normal(3)
    pose[:3, 3] = place - pose[:3, :3] @ middle
    return pose


def _on_table(spec: TargetSpec, seed: int, surface: SceneObject, facts: dict[str, Any]) -> FloatArray:
    """Pose (4, 4) as an operator lays it down: front up, near the middle, turned at random; tilted from placing 1."""
    random = np.random.default_rng([43, seed, spec.placing])
    aside, yaw = random.uniform(-LAID_OFF_M, LAID_OFF_M, 2), random.uniform(-np.pi, np.pi)
    side, tilt = random.uniform(0, 2 * np.pi), random.uniform(*WEDGE_RAD) if spec.placing else 0.0
    upright = geometry.pose((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0)) @ geometry.pose((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    pose = geometry.pose((0.0, 0.0, 0.0), tilt * np.array([np.cos(side), np.sin(side), 0.0])) @ upright
    pose[:2, 3] = aside - (pose[:3, :3] @ _middle(facts))[:2]
    lowest = (surface.mesh.triangles.reshape(-1, 3) @ pose[:3, :3].T)[:, 2].min(initial=0.0)
    pose[2, 3] = ABOVE_TABLE_M - lowest
    return pose
