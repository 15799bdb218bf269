"""The archive's routes: list, search, pages, pictures, files, exports; keys, problems, policy; nothing is written."""

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient

from acquisition.models.errors import RigError
from api.rest import keys
from api.rest.archive_page import routes, server
from api.rest.archive_page.server import ArchivePageSettings
from api.rest.keys import KeyRing, Role

LIST = "/archive/v1/sessions"
NOWHERE = "f" * 64
LARGEST_COMPRESSED_BYTES = 80_000


def listed(http: httpx.Client, **query: Any) -> list[str]:
    answer = http.get(LIST, params=query)
    assert answer.status_code == 200, answer.text
    return [item["object"] for item in answer.json()["items"]]


def first(http: httpx.Client, **query: Any) -> Any:
    return http.get(LIST, params=query).json()["items"][0]


def test_list_is_newest_first_and_searched(http: httpx.Client):
    assert listed(http) == ["Vase, Seite A", "amphora"]
    assert listed(http, search="AMPH") == ["amphora"]
    assert listed(http, search="bbbbbb") == ["amphora"]
    assert listed(http, where="solver is unknown and object ~ 'a'") == ["amphora"]
    assert listed(http, search="vase", where="object = 'amphora'") == []


def test_list_goes_on_where_a_page_ended(http: httpx.Client):
    page = http.get(LIST, params={"limit": 1, "where": "lights > 0"}).json()
    following = http.get(page["next"]).json()
    assert [item["object"] for item in page["items"] + following["items"]] == ["Vase, Seite A", "amphora"]
    assert following["next"] is None


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ({"where": "object ="}, "archive.query_invalid"),
        ({"after": "yesterday_"}, "request.invalid"),
        ({"after": "nan_0"}, "request.invalid"),
        ({"wehre": "x"}, "request.invalid"),
        ({"limit": 0}, "request.invalid"),
    ],
)
def test_list_refuses_a_query_with_a_problem(http: httpx.Client, query: dict[str, Any], code: str):
    answer = http.get(LIST, params=query)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["code"] == code


def test_details_have_results_beside_each_other_and_every_file_is_what_its_hash_says(http: httpx.Client):
    session = http.get(first(http)["links"]["self"]).json()
    assert len(session["results"]) == 2
    assert all(result["state"] == "done" and result["sigma_deg"] > 0 for result in session["results"])
    files = session["files"] + [file for result in session["results"] for file in result["files"]]
    for file in files[::7]:
        answer = http.get(f"{session['links']['self']}/files/{file['path']}")
        assert hashlib.sha256(answer.content).hexdigest() == file["sha256"]
    for result in session["results"]:
        assert http.get(f"{result['links']['self']}/normals.png").headers["content-type"] == "image/png"


def test_files_are_kept_by_the_browser_and_unknown_ones_refused(http: httpx.Client):
    session = first(http)
    address = f"{session['links']['self']}/files/calibration.json"
    answer = http.get(address)
    again = http.get(address, headers={"If-None-Match": answer.headers["etag"]})
    assert "immutable" in answer.headers["cache-control"]
    assert (again.status_code, again.content) == (304, b"")
    for missing in (f"{session['links']['self']}/files/..%2f..%2farchive.json", f"{LIST}/{NOWHERE}"):
        assert http.get(missing).json()["code"] == "archive.not_found"
    assert http.get(f"{LIST}/short").status_code == 422


def test_picture_is_of_the_normals_else_of_the_first_image(http: httpx.Client):
    channels = []
    for item in http.get(LIST).json()["items"]:
        answer = http.get(item["links"]["picture"], params={"width": 60})
        pixels = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
        assert answer.headers["content-type"] == "image/jpeg"
        assert pixels is not None
        assert pixels.shape[1] <= 60
        assert pixels.std() > 3
        channels.append(pixels.ndim)
        again = http.get(
            item["links"]["picture"], params={"width": 60}, headers={"If-None-Match": answer.headers["etag"]}
        )
        assert again.status_code == 304
    assert channels == [3, 2]


@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        ("folder", "recipe.json"),
        pytest.param("bagit", "data/ro-crate-metadata.json", marks=pytest.mark.long),
        pytest.param("relight", "lights.lp", marks=pytest.mark.long),
    ],
)
def test_export_is_a_zip_of_the_form(http: httpx.Client, form: str, wanted: str):
    session = first(http)
    answer = http.get(session["links"]["export"], params={"form": form})
    assert answer.status_code == 200, answer.text
    with zipfile.ZipFile(io.BytesIO(answer.content)) as packed:
        assert packed.testzip() is None
        names = {name.partition("/")[2] for name in packed.namelist()}
    assert wanted in names, names
    assert f'filename="{session["session_id"]}-{form}.zip"' in answer.headers["content-disposition"]


def test_export_to_relight_of_an_unsolved_session_says_why_not(http: httpx.Client):
    answer = http.get(first(http, search="amphora")["links"]["export"], params={"form": "relight"})
    assert (answer.status_code, answer.json()["code"]) == (404, "archive.not_found")


def test_only_reading_is_allowed(http: httpx.Client):
    for address in (LIST, first(http)["links"]["self"]):
        answer = http.delete(address)
        assert answer.status_code in (403, 405)
        assert http.options(address).headers["allow"] == "GET, HEAD, OPTIONS"


def test_damaged_file_is_not_sent(address: str, tmp_path: Path, http: httpx.Client):
    session = http.get(first(http)["links"]["self"]).json()
    file = next(item for item in session["files"] if item["path"] == "arm.txt")
    stored = Path(address) / "objects" / file["sha256"][:2] / file["sha256"]
    content = stored.read_bytes()
    stored.write_bytes(b"rot")
    try:
        answer = http.get(f"{session['links']['self']}/files/arm.txt")
    finally:
        stored.write_bytes(content)
    assert (answer.status_code, answer.json()["code"]) == (500, "archive.damaged")


def test_archive_that_is_away_is_told_and_found_again(address: str, tmp_path: Path):
    moved = tmp_path / "archive"
    wanted = ArchivePageSettings(archive=str(moved), data=tmp_path)
    with TestClient(server.create_app(wanted, KeyRing(keys.path_in(tmp_path))), base_url="http://127.0.0.1") as client:
        assert client.get("/health/live").status_code == 200
        assert client.get("/health/ready").json()["code"] == "archive.address_invalid"
        moved.symlink_to(address)
        assert client.get("/health/ready").json() == {"status": "ok"}
        assert len(client.get(LIST).json()["items"]) == 2
        moved.unlink()
        moved.mkdir()  # the mount point of a disk that went away
        assert client.get("/health/ready").json()["code"] == "archive.address_invalid"


def test_keys_are_asked_for_and_a_viewer_s_is_enough(address: str, tmp_path: Path):
    secret = keys.add(keys.path_in(tmp_path), "reader", Role.VIEWER)
    wanted = ArchivePageSettings(archive=address, data=tmp_path)
    with TestClient(server.create_app(wanted, KeyRing(keys.path_in(tmp_path))), base_url="http://127.0.0.1") as client:
        assert client.get(LIST).json()["code"] == "request.unauthenticated"
        assert client.get("/archive").status_code == 200
        authorized = {"Authorization": f"Bearer {secret}"}
        assert client.get(LIST, headers=authorized).status_code == 200
        ticket = client.post("/v1/tickets", headers=authorized).json()["ticket"]
        assert client.get(f"{first(client, ticket=ticket)['links']['self']}?ticket={ticket}").status_code == 200


def test_server_does_not_listen_to_others_without_keys(address: str, tmp_path: Path):
    with pytest.raises(RigError, match="anybody who reaches it could read the archive"):
        server.serve(ArchivePageSettings(archive=address, data=tmp_path, host="archive.lab", port=0), print)


def test_page_is_served_under_strict_policy(http: httpx.Client):
    for name in ("/archive", "/archive/page/archive.js", "/archive/page/archive.css"):
        answer = http.get(name)
        assert answer.status_code == 200, name
        assert answer.headers["content-security-policy"].startswith("default-src 'self';")
        assert "unsafe" not in answer.headers["content-security-policy"]
    assert str(http.get("/").url).endswith("/archive")


def test_description_names_the_routes(http: httpx.Client):
    described = json.loads(http.get("/openapi.json").content)
    assert LIST in described["paths"]


def test_bundle_is_small_and_names_no_other_host():
    for name, file in routes.bundle().items():
        hosts = set(re.findall(rb"https?://([\w.-]+)", file.content)) - {b"www.w3.org"}  # names of XML, not addresses
        assert hosts == set() or name == "licences.txt", (name, hosts)
    assert sum(len(file.compressed) for file in routes.bundle().values()) < LARGEST_COMPRESSED_BYTES


def test_service_of_a_cell_with_an_archive_has_its_page(start: Callable[..., Any], address: str):
    with start(archive=address) as cell:
        page = cell.http.get("/archive")
        assert page.status_code == 200
        assert "archive/page/archive.js" in page.text
        assert {item["object"] for item in cell.http.get(LIST).json()["items"]} == {"Vase, Seite A", "amphora"}
        assert cell.http.get("/v1/rig").status_code == 200


def test_service_of_a_cell_without_an_archive_has_no_such_page(start: Callable[..., Any]):
    with start() as cell:
        assert cell.http.get("/archive").status_code == 404
        assert cell.http.get(LIST).status_code == 404
