"""`lightpose camera`: takes frames of a cell's camera without the arm, and reports losses, intervals and noise.

Losses are counted by the same code as in sessions. The noise is temporal: for each pixel the standard deviation of the
differences from frame to frame over √2. Their median is stated, so that neither texture nor slow drift of the light
counts. Nothing but the camera is connected, and nothing moves.
"""

import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from acquisition.capture import camera_fit
from acquisition.devices import Camera, CameraFault, StopToken
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.calibration import SensorModel
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.rounding import percent
from api.rest import wiring

EXPOSURE_S = 0.01
"""Default exposure time, s; clipped to the cell file's limits."""

COUNTED = ("good", "lost", "late", "doubled", "damaged", "settings", "gone", "returned", "retaken")
"""Counted events in the order of printing: frames, faults by kind, returns of the camera, frames taken again."""


@dataclass(frozen=True)
class Trial:
    """Result of a trial; intervals in s from one exposure to the next; level above black and noise in DN."""

    camera: str
    width: int
    height: int
    bits: int
    exposure_s: float
    counts: dict[str, int]
    faults: list[str]
    settings: list[str]  # fingerprints that frames had: one, unless something changed
    interval_median_s: float | None
    interval_max_s: float | None
    level_dn: float
    level_drift: float  # relative change of the mean level from the first to the last frame
    noise_dn: float | None
    warnings: list[str]


def run(cell_file: Path, count: int, exposure_s: float | None) -> Trial:
    """Takes `count` frames and repeats each until it is good.

    Raises RigError config.invalid, request.invalid, camera.unreachable within 3 s, camera.timeout if a frame stays bad.
    """
    cell = cell_config.load(cell_file)
    calibration = cell_config.load_calibration(cell_file.parent / cell.calibration)
    limits = cell.camera
    wanted_s = min(max(EXPOSURE_S, limits.min_exposure_s), limits.max_exposure_s) if exposure_s is None else exposure_s
    limits.require_exposure(wanted_s)
    camera = wiring.build_camera(limits)
    faults: list[CameraFault] = []
    camera.listen(faults.append)
    try:
        camera.connect()
        known = camera.capabilities
        assert known is not None  # noqa: S101 - connecting has set it
        warnings = camera_fit.require_fit(known, calibration, limits)
        measured = _frames(camera, count, wanted_s, calibration.sensor)
    finally:
        camera.close()
    return Trial(
        camera=known.name,
        width=known.width,
        height=known.height,
        bits=known.bits,
        exposure_s=wanted_s,
        counts={name: camera.counts[name] for name in COUNTED},
        faults=[f"{fault.kind}: {fault.detail}" for fault in faults],
        settings=measured.settings,
        interval_median_s=measured.interval_median_s,
        interval_max_s=measured.interval_max_s,
        level_dn=measured.level_dn,
        level_drift=measured.level_drift,
        noise_dn=measured.noise_dn,
        warnings=warnings,
    )


def print_trial(trial: Trial) -> None:
    """Prints a trial for people."""
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print(f"{trial.camera}: {trial.width} × {trial.height} pixels of {trial.bits} bits")
    for warning in trial.warnings:
        console.print(f"  {warning}")
    lost = {name: number for name, number in trial.counts.items() if number and name != "good"}
    said = ", ".join(f"{number} {name}" for name, number in lost.items()) or "none lost, late, doubled or damaged"
    console.print(f"{trial.counts['good']} frames of {trial.exposure_s:g} s: {said}")
    for fault in trial.faults:
        console.print(f"  {fault}")
    if trial.interval_median_s is not None:
        console.print(f"intervals: median {trial.interval_median_s:.3f} s, longest {trial.interval_max_s:.3f} s")
    noise = "" if trial.noise_dn is None else f", noise {trial.noise_dn:.2f} DN (1 σ, from frame to frame)"
    console.print(
        f"level {trial.level_dn:.1f} DN above black, drift {percent(trial.level_drift, 2, signed=True)}{noise}"
    )


def as_dictionary(trial: Trial) -> dict[str, object]:
    """Returns the trial as a dictionary for JSON."""
    return asdict(trial)


@dataclass(frozen=True)
class _Measured:
    settings: list[str]
    interval_median_s: float | None
    interval_max_s: float | None
    level_dn: float
    level_drift: float
    noise_dn: float | None


def _frames(camera: Camera, count: int, exposure_s: float, sensor: SensorModel) -> _Measured:
    never = StopToken()
    begun: list[float] = []
    levels: list[float] = []
    settings: set[str] = set()
    before: FloatArray | None = None
    squares: FloatArray | None = None
    for number in range(count):
        begun.append(time.monotonic())
        while True:
            try:
                frame = camera.expose(exposure_s, number, never)
                break
            except RigError as error:
                if not camera.is_gone or error.code is ErrorCode.REQUEST_INVALID:
                    raise
                camera.take_up(never)
        pixels = frame.pixels.astype(np.float64) - sensor.black_level_dn
        levels.append(float(pixels.mean()))
        if frame.settings is not None:
            settings.add(frame.settings.fingerprint)
        if before is not None:
            change = (pixels - before) ** 2
            squares = change if squares is None else squares + change
        before = pixels
    intervals = np.diff(begun)
    noise = None if squares is None else float(np.median(np.sqrt(squares / (2 * (count - 1)))))
    return _Measured(
        settings=sorted(settings),
        interval_median_s=float(np.median(intervals)) if len(intervals) else None,
        interval_max_s=float(intervals.max()) if len(intervals) else None,
        level_dn=float(np.mean(levels)),
        level_drift=(levels[-1] - levels[0]) / max(abs(levels[0]), 1e-9),
        noise_dn=noise,
    )
