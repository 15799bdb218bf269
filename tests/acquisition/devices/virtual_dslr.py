"""libgphoto2's virtual camera, which hands out the file that lies in its folder; `VCAMERADIR` names it."""

from pathlib import Path

import numpy as np

from acquisition.models.camera_config import GphotoCameraConfig
from tests.acquisition.devices.raw_file import dng

CONFIG = GphotoCameraConfig(
    kind="gphoto", width=48, height=32, bits=12, settings={"f-number": "f/8"}, min_exposure_s=0.0009,
    max_exposure_s=1.0, timeout_s=60.0, reconnect_s=60.0,
)  # fmt: skip
FIFTIETH = 2 ** (-17 / 3)
"""What a camera means by 0.0200 s."""


class Virtual:
    """The virtual camera's folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "DCIM" / "100NCD40" / "x.JPG"
        self._file.parent.mkdir(parents=True)
        self.content = self.last = b""
        self.show(0)

    def show(self, label: int) -> None:
        """The next image's first row of green sites is the label; the rest is noise."""
        pixels = np.random.default_rng().integers(64, 4095, (64, 96)).astype(np.uint16)
        pixels[:2] = label
        self.put(dng(pixels))

    def put(self, content: bytes) -> None:
        self.content = content
        self._file.write_bytes(content)
