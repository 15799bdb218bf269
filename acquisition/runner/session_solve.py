"""The near-light solve of a session's images in its cell, which service and command line share."""

from acquisition.capture import region
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals import solve


def solve_in_cell(
    observations: Observations, cell: CellConfig, calibration: Calibration, settings: SolveSettings
) -> NormalMap:
    """Solves near-light photometric stereo with what the cell file says of the scene.

    The object is inside the keep-out cylinder, whose centre is the initial depth, and stands on the cell's table.
    Raises RigError normals.infeasible.
    """
    return solve(
        observations,
        calibration,
        settings,
        initial_depth_m=region.middle_depth_m(cell, calibration),
        region=region.keep_out(cell, calibration),
        table_depth_m=region.table_depth_m(cell, calibration),
    )
