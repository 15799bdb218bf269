"""Captured images with the measurements made during their exposures, and the set of all images of a session."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field

from acquisition.models.base import FloatArray, Joints, Matrix4, Value
from acquisition.models.camera import CameraRecord
from acquisition.models.light_plan import Light


class ShotKey(Value):
    """Key of an image in its session: the pass, and the number within the pass."""

    pass_number: int = Field(ge=0, description="Number of the pass")
    number: int = Field(ge=0, description="Number within the pass")


class FrameRef(Value):
    """A frame's file, relative to the session folder; linear 16-bit, row 0 at the top."""

    path: str = Field(description="File, relative to the session folder")
    width: int = Field(description="Width, px")
    height: int = Field(description="Height, px")
    sha256: str = Field(description="SHA-256 of the file, 64 hexadecimal digits")


class FrameQuality(Value):
    """Result of the check of a frame. Shares are of the object's pixels, or of the frame if no mask is known."""

    saturated: float = Field(description="Share of saturated pixels, 0 to 1")
    bright_level: float = Field(description="99.5th percentile above black, fraction of full scale")
    sharpness: float | None = Field(
        default=None, description="Share of the finest detail in all detail, which blur lowers; none: not measured"
    )
    shift_px: float | None = Field(
        default=None, description="How far the object seems to have moved since it was first seen; none: not measured"
    )
    accepted: bool = Field(description="Whether the image is used; else it is taken again")
    reason: str = Field(default="", description="Why it was rejected; empty: it was not")


class ShotMotion(Value):
    """Motion of the lamp during the exposure of an image taken while the arm moved (`capture.while_moving`)."""

    moved_m: float = Field(description="Largest distance between two places of the lamp during the exposure, m")
    sigma_m: float = Field(
        description="1 σ per axis of its place about the one recorded, by that motion and by the clocks; m"
    )


class Shot(Value):
    """One image and the measurements made during its exposure."""

    key: ShotKey = Field(description="Pass and number")
    kind: Literal["light", "dark", "reference", "bracket"] = Field(
        description="`light`: lamp on; `dark`: lamp off; `reference`: taken a second time, for the noise; `bracket`: a "
        "further frame of a light, merged with its `light` frame"
    )
    frame: FrameRef = Field(description="The file")
    exposure_s: float = Field(description="Exposure time, s")
    light_number: int | None = Field(default=None, description="Number of its light in the pass's plan; null: lamp off")
    further_s: list[float] = Field(
        default_factory=list[float],
        description="Of a `light` frame, the exposure times of the light's further frames in the order in which they "
        "are taken, s",
    )
    repeats: ShotKey | None = Field(default=None, description="Key of the image that this one repeats")
    light: Light | None = Field(default=None, description="From the measured tool pose, never from the commanded pose")
    joints: Joints | None = Field(default=None, description="Joint angles measured at exposure, rad")
    base_from_tool: Matrix4 | None = Field(
        default=None, description="Measured pose of the tool frame (TCP) in the base frame, homogeneous, rows; m"
    )
    lamp_on: bool = Field(default=False, description="Whether the lamp was on")
    attempt: int = Field(default=0, description="How often this image was rejected before")
    arm_time_s: float | None = Field(default=None, description="The controller's own time at exposure, s")
    taken_at: float = Field(description="Seconds since 1970, UTC")
    quality: FrameQuality = Field(description="What the check of the frame found")
    camera: CameraRecord | None = Field(
        default=None, description="The camera's settings and the frame's number; null: the camera reports none"
    )
    motion: ShotMotion | None = Field(
        default=None, description="The lamp's motion during the exposure; null: the arm was at rest"
    )


class FrameSource(Protocol):
    """Reads rows of stored frames, so that a stack need not fit into memory; picklable."""

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame, (rows, W) uint16 linear."""
        ...


@dataclass(frozen=True)
class Observations:
    """All images captured so far: lit shots, the lamp-off frame of each exposure time, and the source of their frames.

    `repeats` are second captures of lit shots and lamp-off frames; only the noise estimate uses them. `further` are the
    further frames of lit shots, by pass and number of the light.
    """

    shots: Sequence[Shot]
    darks: dict[float, Shot]
    frames: FrameSource
    repeats: Sequence[Shot] = ()
    further: Mapping[tuple[int, int], Sequence[Shot]] = field(default_factory=dict[tuple[int, int], Sequence[Shot]])

    @property
    def lit(self) -> list[tuple[Shot, Light]]:
        """The lit shots whose light is known, each with its light."""
        return [(shot, shot.light) for shot in self.shots if shot.kind == "light" and shot.light is not None]

    def frames_of(self, shot: Shot) -> Sequence[Shot]:
        """Returns all frames of a lit shot's light: the shot itself, and the further frames that are merged with it."""
        if shot.light_number is None:
            return (shot,)
        return (shot, *self.further.get((shot.key.pass_number, shot.light_number), ()))

    @classmethod
    def of(cls, captured: Iterable[Shot], frames: FrameSource) -> "Observations":
        """Sorts shots by key into lit, lamp-off, further and repeated ones. Of several lamp-off frames of one exposure
        time, the last counts; the others are repeats."""
        shots = sorted(captured, key=lambda shot: (shot.key.pass_number, shot.key.number))
        darks = {shot.exposure_s: shot for shot in shots if shot.kind == "dark"}
        again = [shot for shot in shots if shot.kind == "reference"]
        older = [shot for shot in shots if shot.kind == "dark" and shot is not darks[shot.exposure_s]]
        further: dict[tuple[int, int], list[Shot]] = {}
        for shot in shots:
            if shot.kind == "bracket" and shot.light_number is not None:
                further.setdefault((shot.key.pass_number, shot.light_number), []).append(shot)
        lit = [shot for shot in shots if shot.kind == "light"]
        return cls(lit, darks, frames, [*again, *older], dict(further))

    def lit_as(self, light_of: Callable[[FloatArray, FloatArray], Light]) -> "Observations":
        """Returns the same images with lights recomputed, as for another calibration, by `light_of` from the measured
        tool poses (4, 4) and joints (6,)."""

        def again(shot: Shot) -> Shot:
            if shot.light is None or shot.base_from_tool is None or shot.joints is None:
                return shot
            light = light_of(np.array(shot.base_from_tool), np.array(shot.joints))
            return shot.model_copy(update={"light": light})

        shots, repeats = [again(shot) for shot in self.shots], [again(shot) for shot in self.repeats]
        return Observations(shots, self.darks, self.frames, repeats, self.further)
