"""Capabilities of a camera, the settings that it reads back, and the record that is stored with each image.

All values are reported by the camera itself. The camera may not have a setting that was written: dials are bumped,
tethering programs write, firmware rounds. A frame therefore counts under the settings that were read back before it.
"""

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field

from acquisition.models.base import Value
from acquisition.models.colour import Mosaic

TriggerKind = Literal["software", "hardware"]
"""A command over the camera's own link, or a level on its input, which an output of the arm's controller sets."""

FaultKind = Literal["lost", "late", "doubled", "damaged", "settings", "gone", "returned"]
"""`lost`: no frame came. `late`: a frame of an earlier trigger came. `doubled`: the previous frame came again.
`damaged`: the frame is incomplete or of another size. `settings`: it was taken with other settings than requested.
`gone`: the camera does not answer. `returned`: it answers again."""


class CameraSettings(Value):
    """Settings of a camera as it reads them back."""

    exposure_s: float = Field(description="Exposure time, s")
    pixel_format: str = Field(description="As the camera names it")
    width: int = Field(description="Width of a frame, px")
    height: int = Field(description="Height of a frame, px")
    gain: float | None = Field(default=None, description="In the camera's own unit; none: not reported")
    black_level: float | None = Field(default=None, description="In the camera's own unit; none: not reported")
    trigger: TriggerKind = Field(default="software", description="What starts an exposure")
    other: Annotated[tuple[tuple[str, str], ...], Field(strict=False)] = Field(
        default=(), description="Further ones by name, such as ISO, aperture, or automatic functions that are off"
    )

    @property
    def fingerprint(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all settings but the exposure time, which changes per image."""
        values = self.model_dump(mode="json", exclude={"exposure_s"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]

    def differences(self, other: "CameraSettings") -> list[str]:
        """Lists the settings but the exposure time that differ in `other`, as text for people."""
        mine, its = (one.model_dump(exclude={"exposure_s", "other"}) | dict(one.other) for one in (self, other))
        return [f"{name}: {mine.get(name)} → {its.get(name)}" for name in mine | its if mine.get(name) != its.get(name)]


class CameraCapabilities(Value):
    """Capabilities that a camera reports when it is connected."""

    name: str = Field(description="Maker, model and serial number, as far as reported")
    width: int = Field(gt=0, description="Width of a frame, px")
    height: int = Field(gt=0, description="Height of a frame, px")
    bits: int = Field(ge=1, le=16, description="Bits of a pixel's value")
    triggers: Annotated[tuple[TriggerKind, ...], Field(strict=False)] = Field(description="How it can be triggered")
    min_exposure_s: float = Field(ge=0, description="Shortest exposure time, s")
    max_exposure_s: float = Field(gt=0, description="Longest exposure time, s")
    mosaic: Mosaic | None = Field(
        default=None, description="Channels of its upper left 2 × 2 sites; none: a monochrome sensor"
    )
    black_level: bool = Field(default=False, description="Whether its black level can be read")
    temperature: bool = Field(default=False, description="Whether it reports its temperature")
    frame_numbers: bool = Field(default=False, description="Whether its frames carry serial numbers")
    chunk_exposure: bool = Field(default=False, description="Whether a frame carries the exposure time it had")


class CameraRecord(Value):
    """Camera settings and frame data that are stored with an image."""

    settings: str = Field(description="Fingerprint of the settings read back, all but the exposure time")
    exposure_s: float = Field(description="Exposure time as read back, s")
    number: int | None = Field(default=None, description="The frame's serial number; none: not reported")
    temperature_c: float | None = Field(default=None, description="The sensor's temperature, °C; none: not reported")
