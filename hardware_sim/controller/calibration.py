"""Factory calibration of an arm: deviations of its Denavit–Hartenberg parameters from the nominal ones.

A real controller knows the measured chain of its own arm; its clients do not. Nominal kinematics are therefore wrong by
millimetres, while the controller's tool pose is right. Each link gets errors of lengths and angles sampled from a seed,
scaled to the requested root mean square, over poses, of the flange's distance from its nominal position.
"""

import math
import random
from dataclasses import replace

from hardware_sim.controller import kinematics
from hardware_sim.controller.kinematics import ArmModel, Link

TYPICAL_ERROR_M = 0.002
_POSES = 64
_SHARE_OF_ANGLES = 1e-3 / 5e-4  # rad per m: angles of 1 mrad go with lengths of 0.5 mm
_ROUNDS = 3  # the error is nearly linear in the deviations


def calibrated(model: ArmModel, seed: int | None, error_m: float = TYPICAL_ERROR_M) -> ArmModel:
    """The arm of a model with calibration `seed`, its flange `error_m` rms off; the nominal arm without a seed."""
    if seed is None:
        return model
    source = random.Random(f"{model.name} {seed}")  # noqa: S311 - a simulation's own noise
    deviations = [[source.gauss(0.0, 1.0) for _ in range(4)] for _ in model.links]
    places = [[source.uniform(-math.pi, math.pi) for _ in range(6)] for _ in range(_POSES)]
    scale = 5e-4
    arm = model
    for _ in range(_ROUNDS):
        links = tuple(_deviated(link, row, scale) for link, row in zip(model.links, deviations, strict=True))
        arm = replace(model, links=links, calibration_seed=seed, calibration_error_m=error_m)
        scale *= error_m / math.sqrt(sum(_error(model, arm, joints) ** 2 for joints in places) / _POSES)
    return arm


def _deviated(link: Link, row: list[float], scale: float) -> Link:
    length, distance, twist, offset = row
    angle = math.atan2(link.sin_twist, link.cos_twist) + twist * scale * _SHARE_OF_ANGLES
    return Link(
        link.length + length * scale,
        link.distance + distance * scale,
        math.cos(angle),
        math.sin(angle),
        offset * scale * _SHARE_OF_ANGLES,
    )


def _error(model: ArmModel, arm: ArmModel, joints: list[float]) -> float:
    nominal, true = kinematics.forward(model, joints), kinematics.forward(arm, joints)
    return math.dist((nominal[3], nominal[7], nominal[11]), (true[3], true[7], true[11]))
