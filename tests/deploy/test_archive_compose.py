"""The compose file of an archive: bounded logs, versions, health; and each part as a process by the file's own command.

No container runs here. PostgreSQL is Debian's, moto stands in for the S3 store; scheduler, workers, the beginning of
the archive and the page are started by the commands of the file with the addresses of this machine in their place.
"""

import contextlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from acquisition.archive import distributed
from api.rest import keys
from api.rest.keys import Role
from tests.acquisition.archive import machines, session_copies

DEPLOY = Path(__file__).parents[2] / "deploy"
WITHIN_S = 240.0
OWN = {"lightpose"}
"""Image that is built here, of this commit."""


def composed() -> dict[str, Any]:
    """The compose file's services."""
    return yaml.safe_load((DEPLOY / "compose.archive.yaml").read_text(encoding="utf-8"))["services"]


def test_archive_compose_bounds_logs_and_names_versions() -> None:
    for name, service in composed().items():
        assert service["logging"] == {"driver": "json-file", "options": {"max-size": "10m", "max-file": "3"}}, name
        assert service["image"] in OWN or re.search(r":\d+(\.\d+)+$", service["image"]), name
        assert "password" not in json.dumps(service.get("environment", {})).lower(), name
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", [])), name


def test_archive_compose_watches_the_health_of_every_server() -> None:
    healthy = {name for name, service in composed().items() if "healthcheck" in service}
    assert healthy >= {"postgres", "store", "scheduler", "page"}
    assert composed()["worker"]["deploy"]["replicas"] == 2


def test_archive_compose_workers_have_the_environment_of_local_ones() -> None:
    environment = composed()["worker"]["environment"]
    assert environment.items() >= distributed.worker_environment(1).items()


@contextmanager
def running(command: Sequence[str], environment: Mapping[str, str], log: Path) -> Generator["subprocess.Popen[bytes]"]:
    """A process for the time of the block; its output is in `log`."""
    with log.open("wb") as file:
        process = subprocess.Popen(command, env={**os.environ, **environment}, stdout=file, stderr=file, cwd=log.parent)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def answers(address: str, log: Path) -> None:
    """Waits until something answers at an address."""
    deadline = time.monotonic() + WITHIN_S
    while True:
        with contextlib.suppress(httpx.HTTPError):
            httpx.get(address, timeout=10)
            return
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.2)


PROGRAMS = {"lightpose": ["-m", "api.cli"], "dask": ["-m", "dask"], "python": []}
"""Entry points of the image as this Python runs them; the image's own is `lightpose`."""


def started_as(service: Mapping[str, Any], places: Mapping[str, str]) -> list[str]:
    """The command of a service with places of this machine for those of the file."""
    program, *first = service.get("entrypoint", ["lightpose"])
    words = [*PROGRAMS[program], *first, *service["command"]]
    for there, here in places.items():
        words = [word.replace(there, here) for word in words]
    return [sys.executable, *words]


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_archive_of_the_compose_file_is_pushed_to_solved_and_shown(tmp_path: Path) -> None:
    services, data = composed(), tmp_path / "data"
    store, scheduler, page = (machines.free_port() for _ in range(3))
    secret = keys.add(keys.path_in(data), "reader", Role.VIEWER)
    places = {
        "0.0.0.0:8787": "127.0.0.1:0",
        "0.0.0.0": "127.0.0.1",  # noqa: S104
        "scheduler:8786": f"127.0.0.1:{scheduler}",
        "8786": str(scheduler),
        "8010": str(page),
        "/data": str(data),
    }
    with contextlib.ExitStack() as parts:
        database = parts.enter_context(machines.postgres())
        environment = {
            "PYTHONPATH": str(DEPLOY.parent),
            "LIGHTPOSE_ARCHIVE_CATALOGUE": database.address,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            **services["page"]["environment"],
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{store}",
        }
        log = tmp_path / "store.log"
        moto = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(store)]
        parts.enter_context(running(moto, environment, log))
        answers(f"http://127.0.0.1:{store}/moto-api/", log)
        subprocess.run(started_as(services["begin"], places), env={**os.environ, **environment}, check=True)
        parts.enter_context(running(started_as(services["scheduler"], places), environment, tmp_path / "scheduler.log"))
        solving = {
            **environment,
            **services["worker"]["environment"],
            "AWS_ENDPOINT_URL": environment["AWS_ENDPOINT_URL"],
        }
        for number in range(services["worker"]["deploy"]["replicas"]):
            log = tmp_path / f"worker{number}.log"
            parts.enter_context(running(started_as(services["worker"], places), solving, log))
        log = tmp_path / "page.log"
        parts.enter_context(running(started_as(services["page"], places), environment, log))
        answers(f"http://127.0.0.1:{page}/health/live", log)

        def call(*arguments: object) -> dict[str, Any]:
            done = subprocess.run(
                [sys.executable, "-m", "api.cli", "archive", *map(str, arguments), "--json"],
                env={**os.environ, **environment}, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            return json.loads(done.stdout.splitlines()[-1])

        folders = [session_copies.make(tmp_path / f"20261121-190041-{seed:06x}", seed) for seed in range(2)]
        (tmp_path / "settings.json").write_text('{"depth_rounds": 1}')
        address, cluster = "s3://objects/archive", f"tcp://127.0.0.1:{scheduler}"
        assert call("push", address, *folders)["new"] == 2
        solved = call("solve", address, "--scheduler", cluster, "--settings", tmp_path / "settings.json")
        assert (solved["solved"], solved["failed"]) == (2, 0)
        with httpx.Client(
            base_url=f"http://127.0.0.1:{page}", headers={"Authorization": f"Bearer {secret}"}, timeout=120
        ) as http:
            assert http.get("/health/ready").json() == {"status": "ok"}
            items = http.get("/archive/v1/sessions").json()["items"]
            details = [http.get(item["links"]["self"]).json() for item in items]
            assert http.get(items[0]["links"]["picture"]).headers["content-type"] == "image/jpeg"
            assert httpx.get(f"http://127.0.0.1:{page}/archive/v1/sessions").status_code == 401
    assert [result["origin"] for one in details for result in one["results"]].count("archive") == 2
    assert all(one["results"][-1]["moved_mean_deg"] is not None for one in details)
