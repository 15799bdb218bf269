"""The `[camera]` section of a cell file, one class for each kind of camera."""

from typing import Annotated, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from acquisition.models.base import Value
from acquisition.models.camera import TriggerKind
from acquisition.models.colour import Mosaic
from acquisition.models.errors import ErrorCode, RigError

GenicamFormat = Literal[
    "Mono8", "Mono10", "Mono12", "Mono16",
    "BayerRG8", "BayerRG10", "BayerRG12", "BayerRG16", "BayerBG8", "BayerBG10", "BayerBG12", "BayerBG16",
    "BayerGR8", "BayerGR10", "BayerGR12", "BayerGR16", "BayerGB8", "BayerGB10", "BayerGB12", "BayerGB16",
]  # fmt: skip
"""Pixel formats with one unpacked value per site. The sites of a mosaic sensor are solved without demosaicing."""

_GENICAM_KEYS = frozenset({
    "PixelFormat", "Width", "Height", "Gain", "GainRaw", "ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw",
})  # fmt: skip
"""Features that have a key of their own."""


class CameraConfig(Value):
    """Settings common to all cameras."""

    min_exposure_s: float = Field(default=1e-4, gt=0)
    max_exposure_s: float = Field(default=1.0, gt=0)
    timeout_s: float = Field(default=30.0, gt=0)
    reconnect_s: float = Field(
        default=60.0,
        ge=0,
        description="How long to wait for a lost camera before the session is interrupted, s",
    )

    @model_validator(mode="after")
    def _has_exposure_times(self) -> Self:
        if self.min_exposure_s > self.max_exposure_s:
            raise ValueError("min_exposure_s must not be above max_exposure_s")
        return self

    def require_exposure(self, exposure_s: float) -> None:
        """Raises RigError request.invalid for an exposure time outside the limits."""
        if not self.min_exposure_s <= exposure_s <= self.max_exposure_s:
            raise RigError(
                ErrorCode.REQUEST_INVALID,
                f"Exposure {exposure_s} s is not within {self.min_exposure_s} to {self.max_exposure_s} s",
            )


class SimCameraConfig(CameraConfig):
    """The camera of the simulated cell, at a TCP port of `address`."""

    kind: Literal["sim"] = "sim"
    address: str
    port: int = Field(default=30100, gt=0, lt=65536)


class LineTriggerConfig(CameraConfig):
    """Settings of a camera whose input may be wired to an output of the arm's controller."""

    trigger: TriggerKind = Field(
        default="software", description="`hardware`: an output of the arm's controller is wired to the camera's input"
    )
    trigger_output: int | None = Field(
        default=None,
        ge=0,
        le=17,
        description='Number of that output, as for the lamp; only with `trigger = "hardware"`',
    )
    trigger_source: str = Field(default="Line0", description="The camera's name of that input")

    @model_validator(mode="after")
    def _names_its_output(self) -> Self:
        """Refuses a hardware trigger without an output, and an output that the software trigger would ignore."""
        if self.trigger == "hardware" and self.trigger_output is None:
            raise ValueError("a hardware trigger needs `trigger_output`")
        if self.trigger == "software" and self.trigger_output is not None:
            raise ValueError(
                "`trigger_output` has no effect with the software trigger: "
                'set `trigger = "hardware"`, or leave out `trigger_output`'
            )
        return self


class GenicamCameraConfig(LineTriggerConfig):
    """Settings of a GigE Vision or USB3 Vision camera."""

    pixel_format: GenicamFormat = "Mono12"
    width: int | None = Field(
        default=None, gt=0, description="Width of the region from the upper left, px; default: the camera's"
    )
    height: int | None = Field(default=None, gt=0, description="Height of that region, px; likewise")
    gain: float | None = Field(default=None, ge=0, description="In dB or the model's unit; default: its minimum")
    settings: dict[str, str] = Field(
        default_factory=dict,
        description="Further features by their GenICam names, such as `ReverseX`, `BinningHorizontal`, `OffsetX`, "
        "`BlackLevel`; set when the camera is connected",
    )

    @model_validator(mode="after")
    def _states_each_once(self) -> Self:
        """Refuses features in `settings` that have a key of their own."""
        for name in self.settings:
            if name in _GENICAM_KEYS or name.startswith(("Trigger", "Acquisition")):
                raise ValueError(f"`settings` must not contain {name}: the driver sets it from the keys of `[camera]`")
        return self


class PylonCameraConfig(GenicamCameraConfig):
    """A Basler camera (GigE or USB3), identified by its serial number; needs the extra `basler`."""

    kind: Literal["pylon"]
    serial: str = Field(min_length=1)
    trigger_source: str = Field(default="Line1", description="The camera's name of that input")


class AravisCameraConfig(GenicamCameraConfig):
    """A GigE Vision or USB3 Vision camera of any maker, through the system's Aravis library."""

    kind: Literal["aravis"]
    device: str = Field(min_length=1, description="Address, or the identifier that `arv-tool-0.8` lists")
    bits: int | None = Field(
        default=None, ge=8, le=16, description="Bits of a value where the pixel format's container has more"
    )


class FolderCameraConfig(CameraConfig):
    """A folder into which a tethering program writes one file for each trigger."""

    kind: Literal["folder"]
    folder: str = Field(min_length=1)
    pattern: str = Field(default="*.tif*", description="Names of its images, with `*` and `?`")
    width: int = Field(gt=0, description="Width of an image, px")
    height: int = Field(gt=0, description="Height of an image, px")
    bits: int = Field(default=16, ge=8, le=16, description="Bits of a value")
    mosaic: Mosaic | None = Field(
        default=None,
        description="The files hold a mosaic sensor's own sites; none: monochrome, or of RAW files the mean of the "
        "green sites, at half the size",
    )
    trigger_command: str = Field(
        default="", description="Program that releases the camera; `{exposure_s}` in it becomes the exposure time"
    )
    trigger_output: int | None = Field(
        default=None, ge=0, le=17, description="Output of the arm's controller that releases it, numbered as the lamp's"
    )
    late_s: float = Field(
        default=2.0, ge=0, description="How long to wait for an overdue file, which is then refused, s"
    )

    @model_validator(mode="after")
    def _can_be_released(self) -> "FolderCameraConfig":
        """Refuses a camera that nothing releases, or two things, and a range of exposure times that nothing sets."""
        if not self.trigger_command and self.trigger_output is None:
            raise ValueError("state `trigger_command` or `trigger_output`: nothing else releases the camera")
        if self.trigger_command and self.trigger_output is not None:
            raise ValueError("state either `trigger_command` or `trigger_output`, not both: one of them releases")
        if "{exposure_s}" not in self.trigger_command and self.min_exposure_s != self.max_exposure_s:
            raise ValueError(
                "nothing sets the exposure time: set `min_exposure_s` and `max_exposure_s` both to that of the program"
            )
        return self


class GphotoCameraConfig(CameraConfig):
    """A DSLR or mirrorless camera on USB, through libgphoto2; RAW files; needs the extra `dslr`."""

    kind: Literal["gphoto"]
    model: str = Field(default="", description="As `gphoto2 --auto-detect` names it; default: the only one there is")
    width: int = Field(
        gt=0, description="Width of an image, px; of a mosaic sensor half the RAW file's, unless `mosaic` is set"
    )
    height: int = Field(gt=0, description="Height of an image, px; likewise")
    bits: int = Field(default=14, ge=8, le=16, description="Bits of a RAW value")
    mosaic: Mosaic | None = Field(
        default=None, description="Keep the sensor's own sites; none: the mean of the green sites, at half the size"
    )
    settings: dict[str, str] = Field(
        default_factory=dict, description="Further settings by libgphoto2's names, such as `iso` and `f-number`"
    )


class MicromanagerCameraConfig(CameraConfig):
    """A camera through one of Micro-Manager's device adapters; needs the extra `micromanager`."""

    kind: Literal["micromanager"]
    adapters: str = Field(min_length=1, description="Folder of the adapters' libraries")
    adapter: str = Field(min_length=1, description="Name of the adapter, such as `DemoCamera`")
    device: str = Field(min_length=1, description="Name of the device in it, such as `DCam`")
    mosaic: Mosaic | None = Field(default=None, description="Of the sensor, where it has one")
    properties: dict[str, str] = Field(
        default_factory=dict, description="Properties of the device, set before each frame"
    )


def _camera_kind(camera: object) -> str:
    kind = camera.get("kind", "sim") if isinstance(camera, dict) else getattr(camera, "kind", "sim")
    return str(cast(object, kind))


AnyCamera = Annotated[
    Annotated[SimCameraConfig, Tag("sim")]
    | Annotated[PylonCameraConfig, Tag("pylon")]
    | Annotated[AravisCameraConfig, Tag("aravis")]
    | Annotated[FolderCameraConfig, Tag("folder")]
    | Annotated[GphotoCameraConfig, Tag("gphoto")]
    | Annotated[MicromanagerCameraConfig, Tag("micromanager")],
    Discriminator(_camera_kind),
]
