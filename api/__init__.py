"""The REST service, its command line and its Python clients; no photometry and no motion of its own.

Scripts import from here: `from api import Client`. A name is loaded on first use, so that `lightpose --help`, which
imports this package too, loads no HTTP library.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from api.client.async_client import AsyncClient
    from api.client.client import Client
    from api.client.responses import ProblemError

__all__ = ["AsyncClient", "Client", "ProblemError"]

_MODULES = {
    "AsyncClient": "api.client.async_client",
    "Client": "api.client.client",
    "ProblemError": "api.client.responses",
}


def __getattr__(name: str) -> Any:
    """Imports a public name on first use (PEP 562). Raises AttributeError for any other name."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
