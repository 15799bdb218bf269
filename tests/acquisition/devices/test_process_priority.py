"""Niceness, in processes of their own so that the suite's stays as it is."""

import os
import subprocess
import sys

import pytest

SCRIPT = "import os; from acquisition import priority; priority.take({}); print(os.getpriority(os.PRIO_PROCESS, 0))"


def niceness_after(wanted: int, user: int | None = None) -> tuple[str, str]:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(wanted)], capture_output=True, text=True, check=True, user=user
    )
    return done.stdout.strip(), done.stderr


def test_set_niceness_background_process_has_low_priority() -> None:
    assert niceness_after(10)[0] == "10"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may choose the user of a process")
def test_set_niceness_without_permission_logs_a_warning() -> None:
    try:
        kept, said = niceness_after(-10, user=65534)
    except (PermissionError, subprocess.CalledProcessError):
        pytest.skip("the checkout cannot be read by another user")
    assert int(kept) >= 0
    assert "not allowed" in said
