"""Frames of a camera that may be gone, taken as the capture stage takes them: wait until it is back, expose again."""

from acquisition.devices import Frame, StopToken
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.models.errors import RigError


def expose_when_back(camera: AccountedCamera, exposure_s: float) -> Frame:
    """Takes one frame, and takes the camera up again as often as it is gone; any other error is raised."""
    never = StopToken()
    while True:
        try:
            return camera.expose(exposure_s, 0, never)
        except RigError:
            if not camera.is_gone:
                raise
            camera.take_up(never)
