"""The simulated cell, and random cells that differ in model, object, camera, tool mount and obstacles."""

import math
from pathlib import Path

import numpy as np

from acquisition import geometry
from acquisition.models import cell_config
from acquisition.models.base import Joints
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import (
    Box,
    Capsule,
    CapsuleShape,
    CellConfig,
    Cone,
    ConvexMesh,
    HalfSpace,
    KeepOut,
    ObjectConfig,
    Obstacle,
    Pose,
)
from acquisition.waypoints.collision import scene

CELLS = Path(__file__).resolve().parents[3] / "hardware_sim" / "cells"
SIZE = {"ur3e": 0.55, "ur5e": 1.0, "ur10e": 1.4, "ur16e": 1.05}
"""Rough reach of each model relative to the UR5e."""


def simulated_cell() -> tuple[CellConfig, Calibration]:
    """The default cell and its calibration."""
    cell = cell_config.load(CELLS / "cell.sim.toml")
    return cell, cell_config.load_calibration(CELLS / cell.calibration)


def random_cell(seed: int) -> tuple[CellConfig, Calibration]:
    """A random cell whose home is free; its lights may be out of reach."""
    random = np.random.default_rng(seed)
    cell, calibration = simulated_cell()
    while True:
        drawn, its_calibration = _draw(random, cell, calibration)
        homes = np.array(cell.arm.home) + random.normal(0, 0.7, (200, 6))
        free = scene(drawn, its_calibration).free(homes)
        if free.any():
            arm = drawn.arm.model_copy(update={"home": _joints(homes[np.argmax(free)])})
            return drawn.model_copy(update={"arm": arm}), its_calibration


def _draw(random: np.random.Generator, cell: CellConfig, calibration: Calibration) -> tuple[CellConfig, Calibration]:
    model = str(random.choice(list(SIZE)))
    scale = SIZE[model]
    away, around = scale * random.uniform(0.45, 0.7), random.uniform(-math.pi, math.pi)
    x, y, z = away * math.cos(around), away * math.sin(around), random.uniform(0.0, 0.1)
    keep_out = KeepOut(
        radius_m=random.uniform(0.04, 0.1),
        height_m=random.uniform(0.03, 0.15),
        base_from_object=Pose(position_m=(x, y, z), rotation_vector_rad=(0.0, 0.0, random.uniform(-3, 3))),
    )
    height = random.uniform(0.75, 1.2)
    # OpenCV's z forward: turned upside down, looking down, a little off the vertical.
    tilt = geometry.pose((0, 0, 0), random.normal(0, 0.08, 3))
    down = geometry.pose((x, y, z + height), (0, 0, 0)) @ tilt @ geometry.pose((0, 0, 0), (math.pi, 0, 0))
    lens, back = down[:3, 3], -down[:3, 2]
    body = Capsule(name="camera", start_m=_vector(lens + 0.06 * back), end_m=_vector(lens + 0.2 * back), radius_m=0.05)
    angle, bracket, arm = random.uniform(0.0, 2.2), random.uniform(0.06, 0.16), random.uniform(0.03, 0.08)
    axis = np.array([math.sin(angle), 0.0, math.cos(angle)])
    emitter = np.array([0.0, 0.0, bracket]) + (arm + 0.01) * axis
    tool = [
        CapsuleShape(start_m=(0.0, 0.0, 0.01), end_m=(0.0, 0.0, bracket), radius_m=0.025),
        CapsuleShape(
            start_m=_vector(emitter - (arm + 0.01) * axis), end_m=_vector(emitter - 0.03 * axis), radius_m=0.025
        ),
    ]
    obstacles = [_obstacle(random, scale, number, keep_out) for number in range(int(random.integers(0, 4)))]
    drawn = cell.model_copy(
        update={
            "arm": cell.arm.model_copy(
                update={
                    "model": model,
                    "flange_from_tool": Pose(position_m=_vector(emitter), rotation_vector_rad=(0.0, angle, 0.0)),
                    "tool_capsules": tool,
                    "cable_allowance_m": random.choice([0.0, 0.01]),
                }
            ),
            "object": ObjectConfig(keep_out=keep_out),
            "camera_body": [body],
            "obstacles": obstacles,
            "dome": cell.dome.model_copy(update={"radius_m": scale * random.uniform(0.3, 0.5), "candidates": 40}),
        }
    )
    return drawn, calibration.model_copy(update={"base_from_camera": tuple(map(tuple, down.tolist()))})


def _obstacle(random: np.random.Generator, scale: float, number: int, keep_out: KeepOut) -> Obstacle:
    """One of the five kinds, somewhere in the arm's workspace, with a clearance of its own or the default one."""
    place = scale * random.uniform((-0.8, -0.8, 0.0), (0.8, 0.8, 0.8))
    pose = Pose(position_m=_vector(place), rotation_vector_rad=_vector(random.normal(0, 1, 3)))
    name = f"obstacle {number}"
    clearance_m = random.choice([None, 0.01, 0.05])
    match int(random.integers(0, 5)):
        case 0:
            sizes = _vector(random.uniform(0.02, 0.1, 3))
            return Box(name=name, clearance_m=clearance_m, base_from_box=pose, half_extents_m=sizes)
        case 1:
            end = _vector(place + random.normal(0, 0.2, 3))
            radius_m = random.uniform(0.01, 0.05)
            start = _vector(place)
            return Capsule(name=name, clearance_m=clearance_m, start_m=start, end_m=end, radius_m=radius_m)
        case 2:
            foot, top, height = random.uniform((0.03, 0.0, 0.05), (0.12, 0.05, 0.3)).tolist()
            return Cone(
                name=name,
                clearance_m=clearance_m,
                base_from_cone=pose,
                foot_radius_m=foot,
                top_radius_m=top,
                height_m=height,
            )
        case 3:
            vertices = [_vector(vertex) for vertex in random.normal(0, 0.06, (int(random.integers(5, 30)), 3))]
            return ConvexMesh(name=name, clearance_m=clearance_m, base_from_mesh=pose, vertices_m=vertices)
        case _:
            # A wall outside the arm's usual workspace, so that its home is not behind it, and not through the object.
            around = random.uniform(-math.pi, math.pi)
            outwards = np.array([math.cos(around), math.sin(around), 0.0])
            behind_object = outwards @ keep_out.base_from_object.position_m + keep_out.radius_m + 0.01
            point = _vector(max(scale * random.uniform(0.75, 1.1), behind_object) * outwards)
            return HalfSpace(name=name, clearance_m=clearance_m, point_m=point, normal=_vector(-outwards))


def _vector(values: geometry.FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return (x, y, z)


def _joints(values: geometry.FloatArray) -> Joints:
    a, b, c, d, e, f = values.tolist()
    return (a, b, c, d, e, f)
