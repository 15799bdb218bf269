"""Errors of captures for a value that kernels compile in; each value is solved in a process that starts with it.

`python -m tests.unseen.fresh_process NAME VALUE CAPTURES PIXELS` replaces a field of the shared settings of
`acquisition.photometry` before any other module of the solver is imported. Numba's cache does not distinguish the
constants of a kernel, so a process with another value compiles into a folder of its own.
"""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace

Errors = dict[str, float]
"""A scene's errors by the name of their quantity."""


def errors(name: str, value: float, captures: str, pixels: int) -> list[Errors]:
    """Each capture's errors for a value of a field of the shared settings."""
    command = [sys.executable, "-m", "tests.unseen.fresh_process", name, str(value), captures, str(pixels)]
    with tempfile.TemporaryDirectory() as cache:
        environment = dict(os.environ) | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def start(name: str, value: float) -> None:
    """Changes a field of the shared settings. Raises RuntimeError if the solver is imported already."""
    if any(one.startswith("acquisition.normals") for one in sys.modules):
        raise RuntimeError("the solver is imported already, with the value as it is")
    from acquisition import photometry

    photometry.SETTINGS = replace(photometry.SETTINGS, **{name: value})  # pyright: ignore[reportAttributeAccessIssue]


def main(name: str, value: float, captures: str, pixels: int) -> None:
    """Solves the captures and prints their errors."""
    start(name, value)

    import numpy as np

    from tests.unseen import grading, patterns, run, scenes
    from tests.unseen.captures import capture

    found: list[Errors] = []
    for family, seed in (one.split(":") for one in captures.split(",")):
        scene = scenes.scene(family, int(seed), None, pixels)
        normal_map = run.solve(scene, capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1)))
        graded = grading.errors(normal_map.normals, normal_map.mask, scene.truth)
        apart = (normal_map.depth - scene.truth.depth_m)[scene.truth.object & normal_map.mask]
        depth = float(np.mean(np.abs(apart - np.median(apart))))
        found.append({
            "error within 78°, deg": graded["within_78_deg.mean"],
            "error of the whole object, deg": graded["object.mean"],
            "error of depth, mm": 1e3 * depth,
        })  # fmt: skip
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
