"""Prints the OpenAPI description: `python -m api.rest.openapi > api/openapi.json` after a change of the routes."""

import json
import sys

from api.rest.app import description


def text() -> str:
    """The OpenAPI description as it is committed in `api/openapi.json`."""
    return json.dumps(description(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
