"""Niceness of background processes, tested in subprocesses so that the suite's own is unchanged."""

import os
import subprocess
import sys

import pytest

SCRIPT = (
    "import os; from acquisition.devices import process_priority; process_priority.set_niceness({}); "
    "print(os.getpriority(os.PRIO_PROCESS, 0))"
)
NOBODY = 65534


def run(script: str, user: int | None = None) -> tuple[str, str]:
    """Standard output and error of a Python process. Raises CalledProcessError, PermissionError."""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, user=user)
    return done.stdout.strip(), done.stderr


def other_user_can_import() -> bool:
    """Whether another user may read the interpreter and the checkout."""
    try:
        run("import acquisition.devices", user=NOBODY)
    except (PermissionError, subprocess.CalledProcessError):
        return False
    return True


def test_set_niceness_background_process_has_low_priority() -> None:
    assert run(SCRIPT.format(10))[0] == "10"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may choose the user of a process")
def test_set_niceness_without_permission_logs_a_warning() -> None:
    if not other_user_can_import():
        pytest.skip("the checkout cannot be read by another user")
    niceness, logged = run(SCRIPT.format(-10), user=NOBODY)
    assert int(niceness) >= 0
    assert "not allowed" in logged
