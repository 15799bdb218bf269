"""The lamp on a digital output of the arm's controller, switched by the arm's driver so that a halt switches it off."""

from acquisition.devices.ur.arm import UrArm
from acquisition.models.cell_config import LampConfig


class UrLamp:
    """A lamp behind one output; shares the driver of its arm."""

    def __init__(self, arm: UrArm, config: LampConfig) -> None:
        self._arm = arm
        self._config = config

    def connect(self) -> None:
        """Ensures that the lamp is off. Raises RigError lamp.not_confirmed, driver.lost."""
        self.set(False)

    def set(self, on: bool) -> None:
        """Sets the level; returns when the controller reads it back.

        Raises RigError lamp.not_confirmed (the lamp has been switched off), device.disconnected, driver.lost; Halted if
        a halt came in between.
        """
        self._arm.set_output(self._config.output, on)

    def close(self) -> None:
        """Leaves the lamp off; if the arm is closed already, its driver has switched it off."""
        if self._arm.is_open:
            self.set(False)
