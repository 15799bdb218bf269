"""The public interface of `acquisition`: exactly these names, loaded lazily."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import acquisition

NAMES = {
    "Calibration": "models.calibration.Calibration",
    "ErrorCode": "models.errors.ErrorCode",
    "ImageSet": "normals.images.image_set.ImageSet",
    "Light": "models.light_plan.Light",
    "LightPlan": "models.light_plan.LightPlan",
    "NormalMap": "models.result.NormalMap",
    "Recipe": "models.recipe.Recipe",
    "ResultSummary": "models.result.ResultSummary",
    "RigError": "models.errors.RigError",
    "SolveSettings": "models.result.SolveSettings",
    "State": "session_state.State",
    "read_folder": "formats.folders.read",
    "read_result": "formats.export.read",
    "read_session": "formats.folders.session_folder.read",
    "solve_distant": "normals.distant.solve",
    "solve_near": "normals.near_light.solve",
    "write_result": "formats.export.write",
}
HEAVY = ("numba", "numpy", "cv2", "scipy", "pydantic", "rtde_control")


def test_public_names_are_exactly_these() -> None:
    assert acquisition.__all__ == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_public_name_is_documented(name: str) -> None:
    assert inspect.getdoc(getattr(acquisition, name))


def test_public_names_for_type_checkers_are_those_loaded() -> None:
    tree = ast.parse(Path(inspect.getfile(acquisition)).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and not node.orelse and _imports(node)]
    stated = {
        alias.asname or alias.name: f"{line.module}.{alias.name}".removeprefix("acquisition.")
        for line in _imports(block)
        for alias in line.names
    }
    assert stated == NAMES
    assert {name: ".".join(source) for name, source in acquisition._SOURCES.items()} == NAMES


def test_unknown_name_raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = acquisition.nonsense  # pyright: ignore[reportAttributeAccessIssue]


def test_importing_acquisition_loads_no_kernel() -> None:
    code = f"import sys, acquisition; print([name for name in {HEAVY} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "[]\n"


def test_importing_a_model_loads_no_kernel() -> None:
    code = "import sys; from acquisition import Recipe, RigError, State; print('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "False\n"


def _imports(node: ast.If) -> list[ast.ImportFrom]:
    return [line for line in node.body if isinstance(line, ast.ImportFrom)]
