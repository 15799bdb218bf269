"""The operator's page as files: served without a key, by a strict policy, and as its sources say."""

import gzip
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

from acquisition.models.camera import FaultKind
from api.rest import page

ROOT = Path(__file__).parents[3]
SOURCES = ROOT / "api" / "page" / "sources"
LARGEST_BYTES, LARGEST_COMPRESSED_BYTES = 700_000, 200_000
LOADED = (".html", ".js", ".css", ".svg")
WORD = re.compile(r'^  "?([\w .-]+)"?:', re.MULTILINE)


def test_page_is_served_without_key_under_strict_policy(shared: Any) -> None:
    for address in ("/", *(f"/page/{name}" for name in page.bundle())):
        answer = shared.http.get(address)
        policy = answer.headers["content-security-policy"]
        assert answer.status_code == 200, address
        assert policy.startswith("default-src 'self';")
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert shared.http.get("/page/nothing.js").status_code == 404
    assert shared.http.get("/page/..%2f..%2fopenapi.json").status_code == 404


def test_page_file_is_compressed_and_revalidated(shared: Any) -> None:
    plain = shared.http.get("/page/page.js", headers={"Accept-Encoding": "identity"})
    again = shared.http.get("/page/page.js", headers={"If-None-Match": plain.headers["etag"]})

    assert plain.content == (ROOT / "api" / "page" / "built" / "page.js").read_bytes()
    assert shared.http.get("/page/page.js").headers["content-encoding"] == "gzip"
    assert gzip.decompress(page.bundle()["page.js"].compressed) == plain.content
    assert again.status_code == 304
    assert again.content == b""
    assert plain.headers["cache-control"] == "no-cache"


def test_page_names_no_other_host() -> None:
    for name, file in page.bundle().items():
        hosts = set(re.findall(rb"https?://([\w.-]+)", file.content)) - {b"www.w3.org"}  # names of XML, not addresses
        assert hosts == set() or name == "licences.txt", (name, hosts)


def test_page_bundle_is_small() -> None:
    loaded = [file for name, file in page.bundle().items() if name.endswith(LOADED)]

    assert sum(len(file.content) for file in loaded) <= LARGEST_BYTES
    assert sum(len(file.compressed) for file in loaded) <= LARGEST_COMPRESSED_BYTES


def test_page_has_words_for_each_fault_of_camera() -> None:
    words = WORD.findall((SOURCES / "words" / "en.ts").read_text("utf-8"))

    assert {f"camera.{kind}" for kind in get_args(FaultKind)} <= set(words)


def words_of(schema: dict[str, Any], schemas: dict[str, Any], above: str = "") -> Iterator[str]:
    """Words that the form of a recipe needs: each field's label and explanation, or its legend, and its choices."""
    for name, field in schema["properties"].items():
        present = next((one for one in field.get("anyOf", [field]) if one.get("type") != "null"), field)
        present = schemas[present["$ref"].rpartition("/")[2]] if "$ref" in present else present
        if name != "kind":
            yield f"recipe.{above}{name}"
            inner = "properties" in present
            yield from words_of(present, schemas, f"{above}{name}.") if inner else (f"explain.{above}{name}",)
            yield from (f"choice.{choice}" for choice in present.get("enum", []))


def test_page_has_words_for_each_field_of_recipes() -> None:
    schemas = json.loads((ROOT / "api" / "openapi.json").read_text("utf-8"))["components"]["schemas"]
    recipes = [schema for name, schema in schemas.items() if name.endswith("Recipe")]
    needed = {word for recipe in recipes for word in words_of(recipe, schemas)}

    assert len(recipes) == 5
    assert needed - set(WORD.findall((SOURCES / "words" / "en.ts").read_text("utf-8"))) == set()


def test_page_words_are_the_same_in_both_languages() -> None:
    english, german = (WORD.findall((SOURCES / "words" / f"{name}.ts").read_text("utf-8")) for name in ("en", "de"))

    assert english == german
    assert len(english) == len(set(english))


def test_page_words_are_all_used() -> None:
    code = "\n".join(
        path.read_text("utf-8") for path in SOURCES.rglob("*.ts") if path.name not in ("en.ts", "de.ts", "api-types.ts")
    )
    families = set(re.findall(r"`([a-z_]+(?:\.[a-z_]+)*)\.\$\{", code))
    words = WORD.findall((SOURCES / "words" / "en.ts").read_text("utf-8"))

    unused = [word for word in words if f'"{word}"' not in code and word.partition(".")[0] not in families]
    assert unused == []


def test_page_modules_are_short() -> None:
    lengths = {
        path.name: len(path.read_text("utf-8").splitlines())
        for path in SOURCES.rglob("*.ts")
        if path.parent.name != "words" and path.name != "api-types.ts"
    }

    assert max(lengths.values()) <= 400, lengths


@pytest.mark.skipif(shutil.which("npm") is None, reason="needs Node: the bundle is built by npm")
@pytest.mark.skipif(not (ROOT / "api/page/node_modules").is_dir(), reason="needs `make page` once: no node_modules")
def test_page_bundle_is_what_sources_give() -> None:
    done = subprocess.run(
        ["node", "build.mjs", "--check"], cwd=ROOT / "api" / "page", capture_output=True, text=True, check=False
    )

    assert done.returncode == 0, done.stderr


def test_page_loaded_again_keeps_its_policy(shared: Any) -> None:
    first = shared.http.get("/")
    again = shared.http.get("/", headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 304
    assert (
        again.headers.get("content-security-policy", first.headers["content-security-policy"])
        == (first.headers["content-security-policy"])
    )
