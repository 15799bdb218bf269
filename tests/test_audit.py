"""The collision audit finds known contacts, so that its empty result is evidence."""

import numpy as np

from acquisition.models.cell_config import Capsule
from tests import audit
from tests.acquisition.waypoints.cells import simulated_cell

HOME = (3.14, -1.6, 1.8, -1.77, -1.57, 1.57)


def pairs(joints: tuple[float, ...], **cell_update: object) -> set[tuple[str, str]]:
    """The pairs of bodies that touch at one configuration of the simulated cell."""
    cell = simulated_cell()[0].model_copy(update=cell_update)
    return {(hit.first, hit.second) for hit in audit.audit(np.array([joints]), cell)}


def test_audit_free_arm_has_no_hits() -> None:
    assert pairs(HOME) == set()


def test_audit_arm_in_table_hits_table() -> None:
    assert ("forearm", "table") in pairs((3.14, 0.3, 0.0, 0.0, 0.0, 0.0))


def test_audit_folded_arm_hits_itself() -> None:
    assert ("shoulder", "forearm") in pairs((3.14, -1.6, 3.1, -1.77, -1.57, 1.57))


def test_audit_tool_camera_and_object_are_checked() -> None:
    cell, _ = simulated_cell()
    tool = audit.link_frames("ur5e", np.array([HOME]))[0, 6] @ np.array([0, 0, 0.1, 1.0])
    x, y, z = tool[:3].tolist()
    at_tool = Capsule(name="camera", start_m=(x, y, z), end_m=(x, y, z + 0.3), radius_m=0.03)
    assert ("tool 0", "camera") in pairs(HOME, camera_body=[at_tool])
    vertices = np.array([[0, 0, -0.2], [0.2, 0, 0.2], [-0.2, 0, 0.2], [0, 0.2, 0.0]]) + tool[:3]
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    hits = audit.audit(np.array([HOME]), cell, object_mesh=(vertices, faces))
    assert ("tool 0", "object") in {(hit.first, hit.second) for hit in hits}


def test_audit_hits_name_their_samples() -> None:
    joints = audit.samples_along([HOME, (3.14, 0.3, 0.0, 0.0, 0.0, 0.0), HOME], 0.05)
    hits = audit.audit(joints, simulated_cell()[0])
    touching = sorted({hit.sample for hit in hits})
    assert touching[0] > 0
    assert touching[-1] < len(joints) - 1
    assert touching == list(range(touching[0], touching[-1] + 1))


def test_thinned_trace_leaves_no_gap() -> None:
    joints = audit.samples_along([HOME, (2.14, -1.2, 1.8, -1.77, -1.57, 1.57)], 0.0005)
    kept = audit.thinned(joints, 0.005)
    assert len(kept) < len(joints) / 5
    assert np.abs(np.diff(kept, axis=0)).max() < 0.006
