"""`lightpose archive …` as a process, given what it cannot use: one sentence and a remedy, and nobody waits for it.

Stores and databases are real ones (moto with its IAM, PostgreSQL) and sockets that take connections and say nothing.
How long a command takes, of which most is imports, is printed: `pytest -s -m long` of this file.
"""

import json
import os
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import sqlalchemy as sa

from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import Catalogue, in_folder, meta
from tests.acquisition.archive import machines, session_copies

GENEROUS_S = 240.0


def test_commands_that_solve_nothing_import_no_solver():
    heavy = "{'numba', 'distributed', 'scipy'}"
    program = f"import sys; import api.cli.archiving; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def refused(*arguments: object, code: str, says: str, user: str | None = None, **environment: str) -> None:
    """The command ends with status 2, one sentence with a code and these words, a remedy, and nothing else."""
    command = [sys.executable, "-m", "api.cli", "archive", *map(str, arguments)]
    used, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(
        command, env=os.environ | environment, user=user, capture_output=True, text=True, check=False,
        timeout=GENEROUS_S,
    )  # fmt: skip
    seconds, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor_s = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    print(f"\n{seconds:5.1f} s, {processor_s:.1f} s of a core: {done.stderr.strip()}")
    sentence, remedy = done.stderr.strip().splitlines()
    assert done.returncode == 2
    assert sentence.startswith(f"{code}: ")
    assert says in sentence
    assert remedy.startswith("  What to do: ")
    assert done.stdout == ""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of one session in a folder."""
    folder = tmp_path_factory.mktemp("archive")
    opened = Archive.create(str(folder / "archive"))
    opened.push(session_copies.make(folder / "20261121-190041-aaaaaa"))
    opened.close()
    (folder / "other.json").write_text('{"depth_rounds": 1}')
    return folder / "archive"


@pytest.fixture(scope="module")
def silent() -> Iterator[str]:
    """Host and port of a server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0), backlog=64) as server:
        yield f"127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.long
@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ("solver < '0.2'; drop table session", "cannot be read at position"),
        ("object =", "cannot be read at its end"),
        ("colour = 'red'", "colour is unknown"),
        ("sigma > 'one'", "compared with a number"),
    ],
)
def test_condition_that_does_not_parse(archive: Path, condition: str, says: str):
    refused("list", archive, "--where", condition, code="archive.query_invalid", says=says)


@pytest.mark.long
def test_catalogue_of_a_newer_version(archive: Path, tmp_path: Path):
    Archive.create(str(tmp_path / "newer")).close()
    newer = Catalogue(in_folder(tmp_path / "newer"))
    newer.repeatedly(lambda connection: connection.execute(meta.insert().values(format=99)).close())
    newer.close()
    refused("list", tmp_path / "newer", code="archive.catalogue_newer", says="format 99")


@pytest.mark.long
def test_folder_that_may_not_be_written(archive: Path, tmp_path: Path):
    """As root, whom no permission stops, where the kernel lets nobody write; else in a folder without the right."""
    folder = Path("/sys") if os.getuid() == 0 else tmp_path
    folder.chmod(0o555)
    refused("create", folder / "archive", code="archive.unreachable", says=str(folder / "archive"))


@pytest.mark.long
@pytest.mark.parametrize("scheduler", ["tcp://127.0.0.1:9", "tcp://SILENT", "nonsense://x"])
def test_scheduler_that_is_none(archive: Path, silent: str, scheduler: str):
    scheduler = scheduler.replace("SILENT", silent)
    refused(
        "solve", archive, "--scheduler", scheduler, "--settings", archive.parent / "other.json",
        code="archive.no_scheduler", says=scheduler,
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------- PostgreSQL


@pytest.fixture(scope="module")
def database() -> Iterator[machines.Postgres]:
    """PostgreSQL with a role that may connect and nothing else."""
    with machines.postgres() as server:
        engine = sa.create_engine(server.address.replace("postgresql:", "postgresql+psycopg:"))
        with engine.begin() as connection:
            connection.execute(sa.text("CREATE ROLE guest LOGIN"))
            connection.execute(sa.text("CREATE ROLE barred NOLOGIN"))
        engine.dispose()
        yield server


@pytest.mark.long
@pytest.mark.parametrize(
    ("role", "says"), [("guest", "permission denied"), ("barred", "not permitted to log in"), ("nobody", "not exist")]
)
def test_role_without_rights(archive: Path, database: machines.Postgres, role: str, says: str):
    address = database.address.replace("lightpose@", f"{role}@")
    refused("list", archive, "--catalogue", address, code="archive.unreachable", says=says)


@pytest.mark.long
def test_postgres_that_is_silent(archive: Path, silent: str):
    address = f"postgresql://lightpose@{silent}/lightpose"
    refused("list", archive, "--catalogue", address, code="archive.unreachable", says="no answer within")


# --------------------------------------------------------------------------------------------------------------- S3


@pytest.fixture(scope="module")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Environment of an S3 store that checks credentials: a bucket, and a user who may do nothing."""
    port = machines.free_port()
    address = f"http://127.0.0.1:{port}"
    said = tmp_path_factory.mktemp("moto") / "log"
    with said.open("wb") as log:
        process = subprocess.Popen([sys.executable, "-m", "moto.server", "-p", str(port)], stdout=log, stderr=log)
    try:
        deadline = time.monotonic() + GENEROUS_S
        while True:
            try:
                httpx.get(f"{address}/moto-api/", timeout=10)
                break
            except httpx.HTTPError:
                assert process.poll() is None, said.read_text()
                assert time.monotonic() < deadline, said.read_text()
                time.sleep(0.2)
        owner = {"AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "owner", "AWS_SECRET_ACCESS_KEY": "secret"}
        owner["AWS_DEFAULT_REGION"] = "us-east-1"
        program = (
            "import boto3, json; boto3.client('s3').create_bucket(Bucket='objects'); iam = boto3.client('iam');"
            "iam.create_user(UserName='guest');"
            "print(json.dumps(iam.create_access_key(UserName='guest')['AccessKey'], default=str))"
        )
        made = subprocess.run(
            [sys.executable, "-c", program], env=os.environ | owner, capture_output=True, text=True, check=True
        )
        key = json.loads(made.stdout)
        httpx.post(f"{address}/moto-api/reset-auth", content=b"0", timeout=60)  # from now on all are asked who they are
        yield owner | {"AWS_ACCESS_KEY_ID": key["AccessKeyId"], "AWS_SECRET_ACCESS_KEY": key["SecretAccessKey"]}
    finally:
        process.terminate()
        process.wait(60)


S3 = ("s3://objects/archive", "--catalogue", "sqlite:///:memory:")


@pytest.mark.long
def test_bucket_that_is_forbidden(s3: dict[str, str]):
    refused("list", *S3, code="archive.unreachable", says="s3://objects/archive: ", **s3)


@pytest.mark.long
def test_credentials_that_are_wrong(s3: dict[str, str]):
    wrong = s3 | {"AWS_SECRET_ACCESS_KEY": "wrong"}
    refused("list", *S3, code="archive.unreachable", says="s3://objects/archive: ", **wrong)


@pytest.mark.long
def test_credentials_that_are_none(s3: dict[str, str], tmp_path: Path):
    none = {"AWS_ENDPOINT_URL": s3["AWS_ENDPOINT_URL"], "AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}
    refused("list", *S3, code="archive.unreachable", says="s3://objects/archive: ", **none, HOME=str(tmp_path))


@pytest.mark.long
def test_bucket_that_is_none(s3: dict[str, str], archive: Path):
    session = next(path for path in archive.parent.iterdir() if path.name.startswith("2026"))
    address = ("s3://nowhere/archive", session, "--catalogue", "sqlite:///:memory:")
    refused("push", *address, code="archive.unreachable", says="s3://nowhere/archive: ", **s3)


@pytest.mark.long
@pytest.mark.parametrize("port", ["9", "SILENT"])
def test_store_that_does_not_answer(silent: str, port: str):
    address = f"http://{silent}" if port == "SILENT" else f"http://127.0.0.1:{port}"
    environment = {"AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}
    refused("list", *S3, code="archive.unreachable", says="s3://objects/archive: ", **environment)
