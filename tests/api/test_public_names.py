"""The public names of `api`: what scripts may import from it, and that importing it loads nothing else."""

import subprocess
import sys
from pathlib import Path

import pytest

import api
from api.client.async_client import AsyncClient
from api.client.client import Client
from api.client.responses import ProblemError

ROOT = Path(__file__).parents[2]

PUBLIC = {"AsyncClient": AsyncClient, "Client": Client, "ProblemError": ProblemError}


def test_api_all_lists_the_public_names() -> None:
    assert api.__all__ == sorted(PUBLIC)
    assert set(PUBLIC) <= set(dir(api))


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_api_public_name_is_the_class_of_its_module(name: str) -> None:
    assert getattr(api, name) is PUBLIC[name]
    assert PUBLIC[name].__doc__


def test_api_unknown_name_raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Server'"):
        api.Server  # noqa: B018


def test_api_import_loads_neither_http_library_nor_kernels() -> None:
    script = "import sys, api; print([name for name in ('httpx', 'fastapi', 'numba', 'numpy') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stderr
