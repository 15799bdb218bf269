"""Preconditions of a session: arm near its path, same arm, enough disk space."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.devices import ArmIdentity
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.runner import preconditions
from acquisition.store import Store
from tests.acquisition.scenes import calibration

angles = st.lists(st.floats(-3, 3), min_size=6, max_size=6)


@given(st.lists(angles, min_size=1, max_size=4), st.floats(0, 1), st.data())
def test_require_near_path_accepts_the_path_and_rejects_beyond(
    path: list[list[float]], share: float, data: st.DataObject
) -> None:
    leg = data.draw(st.integers(0, max(len(path) - 2, 0)))
    end = path[min(leg + 1, len(path) - 1)]
    place = np.array(path[leg]) + share * (np.array(end) - np.array(path[leg]))

    preconditions.require_near_path(path, place.tolist())
    beyond = [*place[:5], 4.0]
    with pytest.raises(RigError) as refused:
        preconditions.require_near_path(path, beyond)
    assert refused.value.code is ErrorCode.ARM_ELSEWHERE
    assert refused.value.context["distance_rad"] <= 4.0 - place[5] + 1e-3


def test_require_near_path_without_path_accepts_any_joints() -> None:
    preconditions.require_near_path([], [1.0] * 6)


def test_require_in_date_expired_calibration_is_refused() -> None:
    now = datetime.now(UTC)
    in_date = calibration(made_at=(now - timedelta(days=1)).isoformat(), valid_days=2.0)
    assert in_date.valid_until == now + timedelta(days=1)
    preconditions.require_in_date(in_date)
    expired = in_date.model_copy(update={"valid_days": 0.5})
    with pytest.raises(RigError, match="out of date since") as refused:
        preconditions.require_in_date(expired)
    assert refused.value.code is ErrorCode.RIG_NOT_READY


def test_require_same_arm_other_serial_is_refused(tmp_path: Path) -> None:
    first = ArmIdentity("ur5e", "2020123", "5.12")
    preconditions.require_same_arm(tmp_path, first)
    preconditions.require_same_arm(tmp_path, ArmIdentity("ur5e", "2020123", "5.13"))
    with pytest.raises(RigError) as refused:
        preconditions.require_same_arm(tmp_path, ArmIdentity("ur5e", "2020999", "5.12"))
    assert refused.value.code is ErrorCode.RIG_CHANGED


def test_require_space_too_large_session_raises_disk_full(tmp_path: Path) -> None:
    store = Store(tmp_path / "data")
    preconditions.require_space_for_session(store, Recipe(), calibration(64))
    preconditions.require_space_for_session(store, None, calibration(64))
    with pytest.raises(RigError) as refused:
        preconditions.require_space_for_session(store, Recipe(), calibration(64, width=10**6, height=10**6))
    assert refused.value.code is ErrorCode.STORE_DISK_FULL
    assert refused.value.context["needed_bytes"] > refused.value.context["free_bytes"]
    store.close()
