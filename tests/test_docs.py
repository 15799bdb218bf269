"""The documentation: links resolve, names exist, generated blocks are current, and the site builds strictly."""

import ast
import importlib.util
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DECISIONS = sorted((DOCS / "decisions").glob("[0-9]*.md"))
PACKAGES = ("acquisition", "api", "hardware_sim", "tests", "deploy", "docs")
BUILD_WITHIN_S = 60


def _pages() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    names = listed.stdout.split() or [str(page.relative_to(ROOT)) for page in [*ROOT.glob("*.md"), *DOCS.rglob("*.md")]]
    return [ROOT / name for name in names if (ROOT / name).exists()]


PAGES = _pages()


def _prose(text: str) -> str:
    """Markdown without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def _anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as repository viewers and as MkDocs make them."""
    anchors: set[str] = set()
    for heading in re.findall(r"^#+ (.+)$", _prose(page.read_text(encoding="utf-8")), re.MULTILINE):
        plain = re.sub(r"[^\w\s-]", "", heading.replace("`", "")).strip().lower()
        anchors |= {plain.replace(" ", "-"), re.sub(r"[-\s]+", "-", plain)}
    return anchors


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_every_page_resolve(page: Path) -> None:
    prose = re.sub(r"`[^`\n]*`", "", _prose(page.read_text(encoding="utf-8")))
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), target
        if anchor:
            assert anchor in _anchors(file), target


@cache
def _defined(module: Path) -> dict[str, set[str]]:
    """The names that a module defines at top level, and for its classes the names in them."""
    names: dict[str, set[str]] = {}

    def targets(statement: ast.stmt) -> list[str]:
        match statement:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                return [statement.name]
            case ast.Assign():
                nodes = [node for target in statement.targets for node in ast.walk(target)]
                return [node.id for node in nodes if isinstance(node, ast.Name)]
            case ast.AnnAssign():
                return [statement.target.id] if isinstance(statement.target, ast.Name) else []
            case ast.ImportFrom() | ast.Import():
                return [alias.asname or alias.name for alias in statement.names]
            case _:
                return []

    body = ast.parse(module.read_text(encoding="utf-8")).body
    conditional = [inner for statement in body if isinstance(statement, ast.If) for inner in statement.body]
    for statement in body + conditional:  # conditional: `if TYPE_CHECKING` of a lazy package
        inner = statement.body if isinstance(statement, ast.ClassDef) else []
        for name in targets(statement):
            names[name] = {item for part in inner for item in targets(part)}
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call(func=ast.Name(id=made), args=[])) if (
                made in names
            ):
                names[name] = names[made]  # an instance has the names of its class
            case _:
                pass
    return names


def _exists(dotted: str) -> bool:
    """Whether `package.module.Name.attribute` is there; the code is read, never imported."""
    parts = dotted.split(".")
    place = ROOT
    for number, part in enumerate(parts):
        if (place / part).is_dir():
            place = place / part
            continue
        if place.joinpath(f"{part}.py").is_file():
            module, rest = place / f"{part}.py", parts[number + 1 :]
        else:
            module, rest = place / "__init__.py", parts[number:]
        if not module.is_file() or len(rest) > 2:
            return False
        names = _defined(module)
        return not rest or (rest[0] in names and (len(rest) == 1 or rest[1] in names[rest[0]]))
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_names_of_every_page_exist(page: Path) -> None:
    for name in re.findall(r"`([\w./-]+)`", _prose(page.read_text(encoding="utf-8"))):
        if name.split("/")[0] in PACKAGES and "/" in name:
            assert (ROOT / name).exists(), name
        elif re.match(r"(acquisition|api|hardware_sim)\.", name):
            assert _exists(name), name


@cache
def _long_and_default_tests(module: Path) -> tuple[set[str], set[str]]:
    """The tests of a module, read from its text: those of the long suite, and the others."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    tests = {node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}
    marks = [
        node for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    if any("pytest.mark.long" in ast.unparse(mark) for mark in marks):
        return {test.name for test in tests}, set()
    long = {test.name for test in tests if any("pytest.mark.long" in ast.unparse(one) for one in test.decorator_list)}
    return long, {test.name for test in tests} - long


def _require_tests(line: str, folder: Path) -> set[str]:
    """The tests that a line of a page names, without a folder those in `folder`; each is there and as long as said."""
    named: set[str] = set()
    for said_long, file, name in re.findall(r"(\(long\) )?`([\w/.]+\.py)::(\w+)`", line):
        module = ROOT / file if "/" in file else folder / file
        assert module.is_file(), line
        assert name in _long_and_default_tests(module)[0 if said_long else 1], f"{said_long}{file}::{name}"
        named.add(name)
    return named


def test_service_tests_page_names_tests_for_every_point() -> None:
    page = (DOCS / "reference" / "service-tests.md").read_text(encoding="utf-8")
    points: set[str] = set()
    named: set[str] = set()
    for line in page.splitlines():
        mentioned = _require_tests(line, ROOT / "tests" / "api" / "rest")
        if match := re.match(r"\| (\d+)[a-z]? \|", line):
            points.add(match[1])
            assert mentioned, line
        named |= mentioned

    assert points == {str(number) for number in range(1, 15)}
    assert len(named) > 80


def test_page_tests_page_names_every_test_of_the_page() -> None:
    folder = ROOT / "tests" / "api" / "page"
    page = (DOCS / "reference" / "page-tests.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if re.match(r"\| \w", line) and "shown by" not in line]
    named = [_require_tests(row, folder) for row in rows]
    every = {name for module in folder.glob("test_*.py") for names in _long_and_default_tests(module) for name in names}

    assert len(rows) > 30
    assert all(names or "`python " in row for row, names in zip(rows, named, strict=True))
    assert every <= set().union(*named)


def _generated_blocks() -> ModuleType:
    specification = importlib.util.spec_from_file_location("generated_blocks", DOCS / "generated_blocks.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_path_of_an_image_names_exist() -> None:
    path = (DOCS / "explanation" / "solver.md").read_text(encoding="utf-8").partition("## The path of an image")[2]
    files = (ROOT / "acquisition" / "normals").rglob("*.py")
    modules = {file.stem: ".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files}
    names = [name.partition(".") for name in re.findall(r"`([\w.]+)`", path)]
    dotted = [f"{modules[module]}{dot}{name}" for module, dot, name in names if module in modules]

    assert len(dotted) > 20
    assert not [name for name in dotted if not _exists(name)]


def test_generated_blocks_follow_the_code() -> None:
    rewritten = _generated_blocks().rewritten

    stale = [page.name for page in DOCS.rglob("*.md") if rewritten(text := page.read_text("utf-8")) != text]

    assert not stale, "run `python docs/generated_blocks.py`"


def test_state_diagram_in_the_docstring_follows_the_table() -> None:
    docstring = ast.get_docstring(ast.parse((ROOT / "acquisition" / "session_state.py").read_text(encoding="utf-8")))

    assert docstring is not None
    assert _generated_blocks().transitions() in docstring


def test_decision_records_have_status_context_decision_consequences() -> None:
    assert [int(page.name[:4]) for page in DECISIONS] == list(range(1, len(DECISIONS) + 1))
    for page in DECISIONS:
        text = page.read_text(encoding="utf-8")
        assert re.findall(r"^## (.+)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"], page.name
        assert re.search(r"^Status: \w+", text, re.MULTILINE), page.name
        assert len(text.splitlines()) <= 40, page.name


def test_tutorial_has_the_script_of_the_readme() -> None:
    def script(page: Path) -> str:
        blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        return next(block for block in blocks if "client.capture" in block)

    assert script(DOCS / "tutorial.md") == script(ROOT / "README.md")


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 110


def test_site_builds_strictly_and_offline(tmp_path: Path) -> None:
    if importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("material") is None:
        pytest.skip("mkdocs-material is not installed: it comes with the extra `dev`")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    built = subprocess.run(
        [*command, "--config-file", str(ROOT / ".mkdocs.yml"), "--site-dir", str(tmp_path)],
        capture_output=True, text=True, timeout=BUILD_WITHIN_S, check=False,
    )  # fmt: skip

    assert built.returncode == 0, built.stdout + built.stderr
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|img|iframe)[^>]+src=.?https?:", text), page.name
        assert not re.findall(r"<link[^>]+rel=.?(?:stylesheet|preconnect)[^>]+href=.?https?:", text), page.name
