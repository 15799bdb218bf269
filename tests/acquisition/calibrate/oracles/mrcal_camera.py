"""Camera calibration by mrcal with the board's warp, run by Debian's python3 with `python3-mrcal`.

`CORNERS.npz OUT.npz`: (V, N, 2) corners of a board of `rows` × `columns` points at `pitch_m`; writes where the camera
puts the directions `rays` (K, 3), pixels (K, 2).
"""

import sys

import mrcal
import numpy as np

given = np.load(sys.argv[1])
corners = given["pixels"]
views, rows, columns = len(corners), int(given["rows"]), int(given["columns"])
observed = np.concatenate([corners.reshape(views, rows, columns, 2), np.ones((views, rows, columns, 1))], axis=-1)
size, focal = given["size"], float(given["focal"])
start = np.concatenate([[focal, focal, size[0] / 2, size[1] / 2], np.zeros(5)])
pinhole = ("LENSMODEL_PINHOLE", start[:4])
poses = mrcal.estimate_monocular_calobject_poses_Rt_tocam(
    np.stack([np.arange(views), np.zeros(views)], axis=1).astype(np.int32), observed, float(given["pitch_m"]), [pinhole]
)
frames = mrcal.rt_from_Rt(poses)
problem = {
    "intrinsics": start[None], "extrinsics_rt_fromref": np.zeros((0, 6)), "frames_rt_toref": frames,
    "points": np.zeros((0, 3)), "observations_point": np.zeros((0, 3)),
    "indices_point_camintrinsics_camextrinsics": np.zeros((0, 3), np.int32),
    "observations_board": np.ascontiguousarray(observed),
    "indices_frame_camintrinsics_camextrinsics": np.stack(
        [np.arange(views), np.zeros(views), -np.ones(views)], axis=1
    ).astype(np.int32),
    "lensmodel": "LENSMODEL_OPENCV5", "imagersizes": size[None].astype(np.int32),
    "calibration_object_spacing": float(given["pitch_m"]), "calobject_warp": np.zeros(2), "point_min_range": 0.1,
    "point_max_range": 10.0, "verbose": False,
}  # fmt: skip
steps = [
    {"do_optimize_intrinsics_distortions": False, "do_optimize_calobject_warp": False},
    {"do_optimize_intrinsics_distortions": True, "do_optimize_calobject_warp": True},
]
for step in steps:
    options = {"do_optimize_intrinsics_core": True, "do_optimize_extrinsics": False, "do_optimize_frames": True}
    mrcal.optimize(**problem, **options, **step, do_apply_regularization=False, do_apply_outlier_rejection=False)
found = problem["intrinsics"][0]
np.savez(sys.argv[2], pixels=mrcal.project(given["rays"], "LENSMODEL_OPENCV5", found), intrinsics=found)
