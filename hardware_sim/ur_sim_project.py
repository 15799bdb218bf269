"""The simulated controller as a distribution of its own, `lightpose-ur-sim`, for other projects' tests.

    python -m hardware_sim.ur_sim_project FOLDER      writes the project; `make ur-sim-wheel` builds its wheel in dist/

Its import name is `lightpose_ur_sim`: a distribution that also owned `hardware_sim` could not be installed beside
lightpose. There is one copy of the code: the files are those of `hardware_sim/controller`, with the package's name
replaced. It needs Python's standard library; `[collisions]` adds NumPy for surroundings and for reading records back.
"""

import shutil
import sys
import tomllib
from pathlib import Path

SOURCE = Path(__file__).parent / "controller"
NAME = "lightpose_ur_sim"
_ROOT = SOURCE.parents[1]
_README = """# lightpose-ur-sim

A UR controller in software for the tests of programs that drive a Universal Robots arm: RTDE, dashboard, script ports,
URScript, motion and safety on real sockets; it starts in a quarter of a second and fails on command. Linux, Python
3.11 or later, standard library only. No part of Universal Robots A/S.

```sh
python -m lightpose_ur_sim --address 127.0.0.2 --model ur20
```

```python
def test_robot_stops(ur_controller):  # a fixture of this package
    ur_controller.control.fault("protective_stop", at_move=1)
    my_program(ur_controller.address)
```
"""
_PROJECT = """[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "lightpose-ur-sim"
version = "{version}"
description = "A simulated UR controller on real sockets, for tests of programs that drive a Universal Robots arm."
readme = "README.md"
license = "Apache-2.0"
license-files = ["LICENSE", "LICENSE.ur_description"]
requires-python = ">=3.11"
dependencies = []
classifiers = ["Framework :: Pytest", "Operating System :: POSIX :: Linux", "Topic :: Scientific/Engineering"]

[project.optional-dependencies]
collisions = ["numpy"]

[project.scripts]
lightpose-ur-sim = "lightpose_ur_sim.__main__:main"

[project.entry-points.pytest11]
lightpose_ur_sim = "lightpose_ur_sim.pytest_plugin"

[tool.setuptools]
packages = ["lightpose_ur_sim"]
package-data.lightpose_ur_sim = ["*.json", "*.toml", "py.typed"]
"""


def write(folder: Path) -> None:
    """Writes the project's files; `folder` is made and must be empty or absent. Raises OSError."""
    package = folder / NAME
    package.mkdir(parents=True)
    for file in sorted(SOURCE.iterdir()):
        if file.suffix == ".py":
            text = file.read_text(encoding="utf-8")
            text = text.replace("hardware_sim.controller", NAME).replace("hardware_sim/controller", NAME)
            (package / file.name).write_text(text, encoding="utf-8")
        elif file.suffix in (".json", ".toml"):
            shutil.copy(file, package)
    (package / "py.typed").touch()
    shutil.copy(_ROOT / "LICENSE", folder)
    # The link spheres of the collision check are made from its meshes.
    shutil.copy(_ROOT / "acquisition" / "waypoints" / "meshes" / "LICENSE", folder / "LICENSE.ur_description")
    version = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    failures = (_ROOT / "docs" / "reference" / "ur-rtde-failures.md").read_text(encoding="utf-8")
    failures = failures.replace("[simulated controller](simulated-controller.md)", "simulated controller")
    (folder / "README.md").write_text(f"{_README}\n#{failures}", encoding="utf-8")
    (folder / "pyproject.toml").write_text(_PROJECT.format(version=version), encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
