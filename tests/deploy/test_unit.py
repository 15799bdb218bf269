"""The systemd unit, by systemd's own verification, and the compose file: they allow what driver and service do."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from api.rest import capacity

DEPLOY = Path(__file__).parents[2] / "deploy"
UNIT = DEPLOY / "lightpose.service"
COMPOSE = DEPLOY / "compose.yaml"
MOST_EXPOSED = 3.0
NEEDED = {"sched_setscheduler", "setpriority", "mlockall", "memfd_create", "pidfd_open", "prlimit64"}
"""System calls of real time, shared memory and the second halt path."""

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def analysed(*arguments: str) -> str:
    """What systemd-analyze says."""
    done = subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, check=False, timeout=120)
    return done.stdout + done.stderr


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The unit with a command that exists, and a user that does, for systemd looks them up."""
    text = UNIT.read_text(encoding="utf-8")
    text = re.sub(r"/opt/lightpose/\.venv/bin/lightpose", "/bin/true", text).replace("User=lightpose", "User=daemon")
    copy = tmp_path / UNIT.name
    copy.write_text(text.replace("Documentation=", "# "), encoding="utf-8")
    return copy


@pytest.mark.long
@needs_systemd
def test_unit_is_verified_by_systemd(unit: Path) -> None:
    assert unit.name not in analysed("verify", "--recursive-errors=no", str(unit))


@pytest.mark.long
@needs_systemd
def test_unit_exposure_is_low(unit: Path) -> None:
    told = analysed("security", "--offline=true", "--no-pager", str(unit))
    match = re.search(r"Overall exposure level for \S+: ([\d.]+)", told)
    assert match is not None, told
    print(f"\nexposure {match[1]}")
    assert float(match[1]) <= MOST_EXPOSED


@pytest.mark.long
@needs_systemd
def test_unit_allows_the_system_calls_of_real_time() -> None:
    filters = re.findall(r"^SystemCallFilter=(\S+)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)
    assert filters == ["@system-service"]
    groups: dict[str, list[str]] = {}
    for line in analysed("syscall-filter", "--no-pager").splitlines():
        if line.startswith("@"):
            groups[line.strip()] = []
        elif (name := line.strip()) and not name.startswith("#") and groups:
            groups[next(reversed(groups))].append(name)
    allowed, waiting = set[str](), filters
    while waiting:
        allowed.add(name := waiting.pop())
        waiting += groups.get(name, [])
    assert allowed >= NEEDED


def test_unit_allows_the_sockets_that_cameras_are_found_by() -> None:
    line = re.search(r"^RestrictAddressFamilies=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)
    assert line is not None
    assert {"AF_INET", "AF_NETLINK"} <= set(line[1].split())


def test_unit_grants_real_time_without_a_capability() -> None:
    text = UNIT.read_text(encoding="utf-8")
    assert "\nLimitRTPRIO=1\n" in text
    assert "\nCapabilityBoundingSet=\n" in text
    assert "RestrictRealtime" not in text


def composed() -> dict[str, Any]:
    """The compose file's services."""
    return yaml.safe_load(COMPOSE.read_text(encoding="utf-8"))["services"]


def test_deployments_grant_the_descriptors_that_the_service_asks_for() -> None:
    wanted = capacity.WANTED_DESCRIPTORS

    assert f"\nLimitNOFILE={wanted}\n" in UNIT.read_text(encoding="utf-8")
    assert composed()["service"]["ulimits"]["nofile"] == {"soft": wanted, "hard": wanted}


def test_compose_bounds_the_log_of_every_container() -> None:
    for name, service in composed().items():
        assert service["logging"] == {"driver": "json-file", "options": {"max-size": "10m", "max-file": "3"}}, name


def test_compose_asks_for_no_limit_that_an_engine_without_root_is_refused() -> None:
    raised = {name: service["ulimits"]["rtprio"] for name, service in composed().items()}
    assert raised == dict.fromkeys(composed(), "${LIGHTPOSE_RTPRIO:-0}")
