"""KinHEC's trajectories and reference solvers (Aiersilan 2025), run in an environment that has `kinhec`.

`generate OUT.npz COUNT`: sequences of a UR5e that holds a board before a fixed camera. `solve POSES.npz OUT.npz`: all
solvers of its benchmark, and OpenCV's, on poses measured there.
"""

import json
import sys

import cv2
import numpy as np
from kinhec import benchmark, camera, config, generator, motions, se3

COLUMNS, ROWS, PITCH_M = 8, 6, 0.012
STATIONS, JOINT_SIGMA_RAD, PIXEL_SIGMA = 20, 5e-5, 0.1
TARGET = "board"
SOLVERS = (
    "tsai_lenz", "park_martin", "horaud_dornaika", "daniilidis", "andreff", "park_martin+lm", "shah", "li_kronecker",
    "shah+lm",
)  # fmt: skip


def generate(out: str, count: int) -> None:
    """Corners, joints and truth of `count` sequences; those that a trajectory cannot be found for are passed over."""
    camera.TARGETS[TARGET] = camera.PlanarTarget(TARGET, COLUMNS, ROWS, PITCH_M, "grid", COLUMNS * ROWS)
    made: dict[str, list] = {"joints": [], "pixels": [], "flange": [], "X": [], "Y": []}
    seed = 0
    while len(made["X"]) < count:
        seed += 1
        sequence = config.SequenceConfig(
            f"pnp-{seed:06d}", "pnp", "", seed, robot="ur5e", configuration="eye_to_hand", family="lookat",
            family_params={"n_waypoints": STATIONS, "distance_range": [0.25, 0.4]},
            sampling=config.default_sampling() | {"mode": "stations", "n_stations": STATIONS},
            robot_noise=config.default_robot_noise()
            | {"models": ["joint_gaussian"], "joint_std_rad": JOINT_SIGMA_RAD, "rot_std_rad": 0.0, "trans_std_m": 0.0},
            camera_noise=config.default_camera_noise() | {"model": "none"}, camera="industrial_5mp", target=TARGET,
        )  # fmt: skip
        try:
            record = generator.generate_sequence(sequence)
        except generator.GenerationError:
            continue
        table, robot = record.camera_table, record.robot_table
        poses = se3.pq_to_pose(np.stack([table[f"cam_target_gt_{one}"] for one in generator.POSE_COMPONENTS], axis=1))
        flange = se3.pq_to_pose(np.stack([robot[f"base_ee_meas_{one}"] for one in generator.POSE_COMPONENTS], axis=1))
        seen = np.array(table["visible"])
        if seen.sum() < STATIONS:
            continue
        random = np.random.default_rng(seed)
        target, kind = camera.TARGETS[TARGET], camera.CAMERAS["industrial_5mp"]
        pixels = np.stack([camera.project_points(kind, pose, target.points)[0] for pose in poses])
        manifest = record.manifest
        made["joints"].append(np.stack([np.array(one.as_py()) for one in robot["q_meas"]]))
        made["pixels"].append(pixels + PIXEL_SIGMA * random.standard_normal(pixels.shape))
        made["flange"].append(flange)
        for name in "XY":
            made[name].append(
                se3.pq_to_pose(np.array([manifest[f"{name}_{one}"] for one in generator.POSE_COMPONENTS]))
            )
    np.savez(out, **{name: np.array(values) for name, values in made.items()})


def hand_eye(method: int, flange: np.ndarray, board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """OpenCV's calibrateHandEye for a fixed camera, to which the base moves as seen from the flange: Y; X is the mean
    that Y gives."""
    moved = se3.inverse(flange)
    turn, place = cv2.calibrateHandEye(
        moved[:, :3, :3], moved[:, :3, 3], board[:, :3, :3], board[:, :3, 3], method=method
    )
    y = se3.make_transform(turn, place.ravel())
    each = moved @ y @ board
    return se3.make_transform(se3.project_to_so3(each[:, :3, :3].mean(axis=0)), each[:, :3, 3].mean(axis=0)), y


def robot_world(method: int, flange: np.ndarray, board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """OpenCV's calibrateRobotWorldHandEye, board and flange in the places of its camera and gripper: Y⁻¹ and X⁻¹."""
    seen, moved = se3.inverse(board), se3.inverse(flange)
    y_turn, y_place, x_turn, x_place = cv2.calibrateRobotWorldHandEye(
        seen[:, :3, :3], seen[:, :3, 3], moved[:, :3, :3], moved[:, :3, 3], method=method
    )
    x, y = se3.make_transform(x_turn, x_place.ravel()), se3.make_transform(y_turn, y_place.ravel())
    return se3.inverse(x), se3.inverse(y)


OPENCV = {
    "Tsai": (hand_eye, cv2.CALIB_HAND_EYE_TSAI), "Park": (hand_eye, cv2.CALIB_HAND_EYE_PARK),
    "Horaud": (hand_eye, cv2.CALIB_HAND_EYE_HORAUD), "Andreff": (hand_eye, cv2.CALIB_HAND_EYE_ANDREFF),
    "Daniilidis": (hand_eye, cv2.CALIB_HAND_EYE_DANIILIDIS),
    "Shah": (robot_world, cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH), "Li": (robot_world, cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI),
}  # fmt: skip


def solve(poses: str, out: str) -> None:
    """(S, N, 2, 4, 4) X and Y of all solvers for N sequences of flange poses and measured board poses (N, V, 4, 4)."""
    given = np.load(poses)
    found = []
    for flange, board in zip(given["flange"], given["board"], strict=True):
        pairs = motions.motion_pairs(len(flange), "consecutive")
        data = flange, board, se3.relative_motions(flange, pairs), se3.relative_motions(board, pairs)
        row = []
        for name in SOLVERS:
            made = benchmark.SOLVERS[name](data, np.random.default_rng(0))
            x, y = made["X"], made.get("Y")
            row.append((x, np.full((4, 4), np.nan) if y is None else y))
        row += [method(number, flange, board) for method, number in OPENCV.values()]
        found.append(row)
    names = [f"KinHEC {name}" for name in SOLVERS] + [f"OpenCV {name}" for name in OPENCV]
    np.savez(out, found=np.array(found), names=json.dumps(names))


if __name__ == "__main__":
    if sys.argv[1] == "generate":
        generate(sys.argv[2], int(sys.argv[3]))
    else:
        solve(sys.argv[2], sys.argv[3])
