"""Reachability map of the dome: the light positions that the arm can serve, and the refusal reason of the others.

A light counts as reachable if it has a valid configuration *and* certified straight joint segments connect that to
home. So a route exists to every light that the planner chooses from this map. Before: the cell file and the
calibration. After: pilot and plan choose from it, `routing` makes the paths.
"""

from collections.abc import Sequence

import numpy as np

from acquisition import lamp_pose
from acquisition.models.base import FloatArray, Joints, Value, Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import Light
from acquisition.models.route import Refusal
from acquisition.waypoints.roadmap import connected_solutions, dome_center, dome_lights


class ReachMap(Value):
    """Reachability map: dome positions (view frame, m), each with its refusal or none; implements `models.route.Reach`.

    Stored as JSON.
    """

    cell: CellConfig
    calibration: Calibration
    points: list[Vector3]
    refusals: list[Refusal | None]
    home: Joints

    @property
    def candidates(self) -> FloatArray:
        """Reachable positions (K, 3), m, view frame."""
        kept = [point for point, refusal in zip(self.points, self.refusals, strict=True) if refusal is None]
        return np.array(kept, dtype=float).reshape(-1, 3)

    @property
    def center(self) -> FloatArray:
        """The dome's centre (3,), m, view frame."""
        return dome_center(self.cell, self.calibration)

    @property
    def radius_m(self) -> float:
        """The dome's radius, m."""
        return self.cell.dome.radius_m

    def allows(self, position: FloatArray) -> Refusal | None:
        """Returns None if the lamp can move to `position` (3,), facing the centre, and back home; else the refusal."""
        return refusals(
            [lamp_pose.light_at(np.asarray(position, dtype=float), self.center)], self.cell, self.calibration
        )[0]


def reach(cell: CellConfig, calibration: Calibration) -> ReachMap:
    """Returns the reachability map of the dome's candidates. Raises RigError waypoints.collision: home not free."""
    lights = dome_lights(cell, calibration, cell.dome.candidates)
    return ReachMap(
        cell=cell,
        calibration=calibration,
        points=[light.position for light in lights],
        refusals=refusals(lights, cell, calibration),
        home=cell.arm.home,
    )


def refusals(lights: Sequence[Light], cell: CellConfig, calibration: Calibration) -> list[Refusal | None]:
    """Returns for each light (view frame) None if it is reachable, else the refusal."""
    return [station.refusal for station in connected_solutions(lights, cell, calibration, first=2).solutions]
