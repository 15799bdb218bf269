"""Description of the object in the simulated cell: built-in, mesh file, random family or calibration target.

The command line, the cell and the world's process pass on this one description. Each that needs the object builds it;
the same seed gives the same object. `check` refuses all invalid ones in the calling process, before it starts another.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from acquisition.models import cell_config
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.cell_config import CellConfig, KeepOut
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import families, mesh_file, objects, targets
from hardware_sim.families import RandomObject
from hardware_sim.objects import SceneObject
from hardware_sim.reflectance import Reflectance
from hardware_sim.sheets import Mesh
from hardware_sim.targets import Target

Source = Literal["built-in", "mesh", "family", "target"]

DEFAULT_NAME = "vase"
"""The built-in object that stands in the cell when none is chosen."""


@dataclass(frozen=True)
class ObjectSpec:
    """An object by its source; `name` is that of a built-in object, a family or a target, or a mesh file's path.

    `size_mm` is the largest extent of a mesh, None for that of its file. `reflectance`, as `Reflectance.parse` reads
    it, replaces the object's own.
    """

    name: str
    source: Source = "built-in"
    size_mm: float | None = None
    reflectance: str | None = None

    @property
    def label(self) -> str:
        """A short name for people, without a mesh's folder."""
        names = {"mesh": Path(self.name).name, "family": f"family {self.name}"}
        plain = names.get(self.source, self.name)
        return plain if self.reflectance is None else f"{plain} ({self.reflectance})"

    def as_json(self) -> str:
        """The description as a line of JSON."""
        return json.dumps(asdict(self))

    def arguments(self) -> list[str]:
        """The command's options from which `choose` makes this description."""
        option = {"mesh": "--mesh", "family": "--family"}.get(self.source, "--object")
        size = [] if self.size_mm is None else ["--size-mm", repr(self.size_mm)]
        reflectance = [] if self.reflectance is None else ["--reflectance", self.reflectance]
        return [option, self.name, *size, *reflectance]

    @staticmethod
    def from_json(line: str) -> "ObjectSpec":
        """Reads what `as_json` writes."""
        return ObjectSpec(**json.loads(line))


def choose(
    object_name: str | None, mesh: Path | None, size_mm: float | None, family: str | None, reflectance: str | None
) -> ObjectSpec:
    """The object that a command's options describe. Raises RigError request.invalid for conflicting options."""
    given = [
        option
        for option, value in (("--object", object_name), ("--mesh", mesh), ("--family", family))
        if value is not None
    ]
    if len(given) > 1:
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"{' and '.join(given)} name different objects: give only one of them"
        )
    if size_mm is not None and mesh is None:
        raise RigError(ErrorCode.REQUEST_INVALID, "--size-mm is the size of a --mesh: give a mesh, or leave it out")
    if mesh is not None:
        return ObjectSpec(str(mesh.resolve()), "mesh", size_mm, reflectance)
    if family is not None:
        return ObjectSpec(family, "family", None, reflectance)
    return replace(as_spec(object_name or DEFAULT_NAME), reflectance=reflectance)


def as_spec(spec: ObjectSpec | str) -> ObjectSpec:
    """A description; a text gives that of the built-in object or calibration target of this name."""
    if not isinstance(spec, str):
        return spec
    return ObjectSpec(spec, "target" if targets.is_name(spec) else "built-in")


def target(spec: ObjectSpec, seed: int, cell: CellConfig) -> Target | None:
    """The described calibration target, or None for an object. Raises RigError request.invalid."""
    if spec.source != "target":
        return None
    if spec.reflectance is not None:
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"the target {spec.name!r} has a fixed reflectance: leave --reflectance out"
        )
    return targets.build(targets.parse(spec.name), seed, targets.nominal_of(cell))


def build(spec: ObjectSpec, seed: int, cell: CellConfig) -> SceneObject:
    """Makes the object; one of a family is scaled down to fit the cell's keep-out, others must fit.

    A target on the flange leaves the table empty, so its mesh is empty.

    Raises RigError request.invalid that names what cannot be made and what can, and config.invalid with both sizes and
    a remedy if the object does not fit the keep-out.
    """
    keep_out = cell.object.keep_out
    made_target = target(spec, seed, cell)
    if made_target is not None:
        on_table = made_target.spec.mount == "table" and made_target.spec.kind != "empty"
        scene = made_target.posed(np.eye(4)) if on_table else targets.nothing()
        _check_fits(spec, scene, keep_out)
        return scene
    reflectance = None if spec.reflectance is None else _reflectance(spec.reflectance)
    if spec.source == "mesh":
        path = Path(spec.name)
        scene = _plain(spec, mesh_file.read(path, spec.size_mm), objects.soft_texture(path.name, seed))
    elif spec.source == "family":
        made = _of_family(spec.name, seed)
        scene = replace(_plain(spec, made.mesh, made.texture), reflectance=made.reflectance)
        share = _share_that_fits(scene, keep_out)
        if share < 1:
            # Smaller by 1e-4, so that rounding does not leave it too large.
            scene = replace(scene, mesh=made.mesh.scaled(0.9999 * share))
    else:
        scene = objects.build(spec.name, seed)
    _check_fits(spec, scene, keep_out)
    return scene if reflectance is None else replace(scene, gloss=0.0, reflectance=reflectance)


def check(spec: ObjectSpec, seed: int, cell_file: Path) -> None:
    """Makes the object and discards it; raises what `build` and reading the cell file raise.

    Of a built-in object only name and reflectance are checked, since all fit the simulated cell. `World` checks the fit
    in any other cell.
    """
    cell = cell_config.load(cell_file)
    if spec.source != "built-in":
        build(spec, seed, cell)
        return
    objects.check_name(spec.name)
    if spec.reflectance is not None:
        _reflectance(spec.reflectance)


def _plain(spec: ObjectSpec, mesh: Mesh, texture: Callable[[FloatArray], FloatArray | Float32Array]) -> SceneObject:
    return SceneObject(spec.label, mesh, texture, 0.0, 30.0)


def _share_that_fits(scene: SceneObject, keep_out: KeepOut) -> float:
    """The largest factor by which the object, scaled, still fits the keep-out; below 1 it is too large."""
    return min(keep_out.radius_m / scene.radius_m, keep_out.height_m / scene.height_m)


def _check_fits(spec: ObjectSpec, scene: SceneObject, keep_out: KeepOut) -> None:
    if not len(scene.mesh.triangles):
        return
    share = _share_that_fits(scene, keep_out)
    if share >= 1:
        return
    said = (
        f"the object {spec.label!r} (radius {1e3 * scene.radius_m:.1f} mm round its axis, height"
        f" {1e3 * scene.height_m:.1f} mm) does not fit into object.keep_out of the cell file (radius"
        f" {1e3 * keep_out.radius_m:.1f} mm, height {1e3 * keep_out.height_m:.1f} mm)"
    )
    remedy = "choose a smaller one or enlarge the cylinder"
    if spec.source == "mesh":
        largest = 1e3 * float(np.ptp(scene.mesh.triangles.reshape(-1, 3), axis=0).max())
        remedy = f"give --size-mm {int(share * largest)} or less, or turn the mesh, or enlarge the cylinder"
    raise RigError(ErrorCode.CONFIG_INVALID, f"{said}; {remedy}", object=spec.name)


def _reflectance(text: str) -> Reflectance:
    try:
        return Reflectance.parse(text)
    except ValueError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, str(error), reflectance=text) from error


def _of_family(name: str, seed: int) -> RandomObject:
    try:
        return families.make(name, seed)
    except ValueError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, str(error), family=name) from error
