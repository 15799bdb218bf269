"""Near-light solve of a session's images in its cell, shared by service and command line."""

import numpy as np

from acquisition import geometry, lamp_pose
from acquisition.capture import region
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals import ObjectPlace, solve
from acquisition.normals.block_solve import BlockMap
from acquisition.normals.images.grey_tile import GreyTile


def solve_in_cell(
    observations: Observations,
    cell: CellConfig,
    calibration: Calibration,
    settings: SolveSettings,
    block_map: BlockMap = map,
) -> NormalMap:
    """Solves near-light photometric stereo with the cell file's description of the scene.

    The object is inside the keep-out cylinder, whose centre is the initial depth, and stands on the cell's table.
    `block_map` solves the blocks of the final solve. Raises RigError normals.infeasible.
    """
    calibration = lamp_pose.with_motion(calibration, observations.shots)
    return solve(
        observations,
        calibration,
        settings,
        ObjectPlace(
            region.middle_depth_m(cell, calibration),
            region=region.keep_out(cell, calibration),
            table_depth_m=region.table_depth_m(cell, calibration),
        ),
        grey_tile=_grey_tile(cell, calibration),
        block_map=block_map,
    )


def _grey_tile(cell: CellConfig, calibration: Calibration) -> GreyTile | None:
    """Returns the cell's grey tile as the camera sees it; None if it has none. Raises RigError config.invalid."""
    mask = region.grey_tile(cell, calibration)
    if mask is None or cell.grey_tile is None:
        return None
    up = np.array(cell.table.normal) / np.linalg.norm(cell.table.normal)
    normal = geometry.rotate(geometry.inverse(lamp_pose.base_from_view(calibration)), up)
    return GreyTile(mask, region.table_depth_m(cell, calibration, cell.grey_tile.height_m), normal)
