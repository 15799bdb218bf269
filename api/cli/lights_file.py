"""Reads positions of lights from a file, for method `user`.

The file is JSON (a list of [x, y, z], or the `plan.json` of one pass), text (three numbers on each line), or a
session's folder (the lights of all its passes). Positions are in m in the view frame (origin at the camera, x right, y
up, z towards the camera). The content determines the form, not the suffix.
"""

import json
import math
import re
from pathlib import Path
from typing import Any

from acquisition.models.base import Vector3
from acquisition.models.errors import ErrorCode, RigError


def read(path: Path) -> list[Vector3]:
    """Reads the positions in a file or a session's folder. Raises RigError request.invalid naming file and line."""
    if path.is_dir():
        plans = sorted(path.glob("passes/*/plan.json"), key=lambda plan: int(plan.parent.name))
        if not plans:
            raise RigError(
                ErrorCode.REQUEST_INVALID, f"{path}: is not a session's folder: it has no passes/0/plan.json"
            )
        return [position for plan in plans for position in read(plan)]
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"{path}: cannot be read: {error}", file=str(path)) from error
    if text.lstrip().startswith(("[", "{")):
        return _of_json(text, path)
    lines = [(number, line.partition("#")[0].strip()) for number, line in enumerate(text.splitlines(), start=1)]
    return [_position(re.split(r"[\s,;]+", line), f"{path}, line {number}") for number, line in lines if line]


def _of_json(text: str, path: Path) -> list[Vector3]:
    try:
        value: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"{path}: is not JSON: {error}", file=str(path)) from error
    items: Any = value.get("lights") if isinstance(value, dict) else value
    if not isinstance(items, list):
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"{path}: give a list of [x, y, z], or a plan with `lights`", file=str(path)
        )
    return [
        _position(item.get("position") if isinstance(item, dict) else item, f"{path}, light {number}")
        for number, item in enumerate(items)
    ]


def _position(numbers: Any, place: str) -> Vector3:
    try:
        x, y, z = (float(number) for number in numbers)
    except (TypeError, ValueError) as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"{place}: {numbers!r} is not three numbers in metres") from error
    if not all(math.isfinite(number) for number in (x, y, z)):
        raise RigError(ErrorCode.REQUEST_INVALID, f"{place}: {numbers!r} contains a value that is not a finite number")
    return (x, y, z)
