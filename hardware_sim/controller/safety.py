"""State machine of robot mode, safety mode and remote control.

It does not know arm and program: the controller asks whether they may run, and applies stops to them. Powering on,
releasing brakes and booting take time, as on a real controller (some seconds each there, shorter here), so that a
client that does not wait for the mode fails here too.
"""

import math

from hardware_sim.controller.modes import RobotMode, SafetyMode

UNLOCK_AFTER = 5.0  # s between a protective stop and its unlocking
POWER_ON_SECONDS = 1.0
BRAKE_SECONDS = 0.5
BOOT_SECONDS = 3.0
RESTART_SECONDS = 1.0

_TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)
_EMERGENCIES = (SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP)


class Safety:
    """The states of one controller; times are time.monotonic() as of the last tick."""

    def __init__(self, now: float) -> None:
        self.robot_mode = RobotMode.RUNNING
        self.safety_mode = SafetyMode.NORMAL
        self.remote_control = True
        self.operational_mode, self.user_role = "NONE", "NONE"
        self.popup: str | None = None
        self.safety_popup: str | None = None
        self._now = now
        self._stopped_at = -math.inf
        self._due = math.inf
        self._next = self.robot_mode
        self._release_after_power = False

    @property
    def may_run(self) -> bool:
        return self.robot_mode is RobotMode.RUNNING and self.safety_mode in (SafetyMode.NORMAL, SafetyMode.REDUCED)

    def tick(self, now: float) -> None:
        """Advances time; a transition that has begun ends when it is due."""
        self._now = now
        if now >= self._due:
            self._due, self.robot_mode = math.inf, self._next
            if self.robot_mode is RobotMode.IDLE and self._release_after_power:
                self.release_brakes()

    def stop(self, mode: SafetyMode, why: str) -> bool:
        """Enters a protective or safeguard stop; returns False if no program may run anyway."""
        if not self.may_run:
            return False
        self.safety_mode = mode
        self.safety_popup = f"{mode.name}: {why}"
        self._stopped_at = self._now
        return True

    def unlock(self) -> str | None:
        """Ends a protective stop and closes its popup; returns the reason if it cannot, else None."""
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return "Cannot unlock protective stop: there is none"
        if self._now - self._stopped_at < UNLOCK_AFTER:
            return _TOO_EARLY
        self._normal()
        return None

    def release_safeguard(self) -> None:
        """Ends a safeguard stop."""
        if self.safety_mode is SafetyMode.SAFEGUARD_STOP:
            self._normal()

    def emergency(self, mode: SafetyMode, why: str) -> None:
        """Enters an emergency stop, a violation or a fault; the arm has no power until that is cleared."""
        self.safety_mode = mode
        self.safety_popup = f"{mode.name}: {why}"
        self.power_off()

    def release_emergency_stop(self) -> None:
        """Ends an emergency stop; the arm stays without power."""
        if self.safety_mode in _EMERGENCIES:
            self._normal()

    def restart(self) -> bool:
        """Ends a violation or a fault by restarting the safety system, which leaves the arm without power."""
        if self.safety_mode not in (SafetyMode.VIOLATION, SafetyMode.FAULT):
            return False
        self._normal()
        self._boot(RESTART_SECONDS)
        return True

    def boot(self) -> None:
        """Boots as after the controller was switched on, which leaves the arm without power."""
        self.remote_control = True
        self.popup = None
        self._normal()
        self._boot(BOOT_SECONDS)

    def reset(self) -> None:
        """Makes the arm powered, its brakes released and the safety mode normal at once."""
        self._due = math.inf
        self.robot_mode = RobotMode.RUNNING
        self.remote_control = True
        self._stopped_at = -math.inf
        self._normal()

    def power_off(self) -> None:
        if self.robot_mode is not RobotMode.BOOTING:
            self._due = math.inf
            self.robot_mode = RobotMode.POWER_OFF

    def power_on(self) -> None:
        """Begins to power the joints; the brakes stay closed."""
        if self.robot_mode is RobotMode.POWER_OFF and self.safety_mode in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            self._release_after_power = False
            self.robot_mode = RobotMode.POWER_ON
            self._after(POWER_ON_SECONDS, RobotMode.IDLE)

    def release_brakes(self) -> None:
        """Begins to open the brakes, after powering on if needed."""
        self.power_on()
        if self.robot_mode is RobotMode.POWER_ON:
            self._release_after_power = True
        elif self.robot_mode is RobotMode.IDLE and self._due == math.inf:
            self._after(BRAKE_SECONDS, RobotMode.RUNNING)

    def _normal(self) -> None:
        self.safety_mode = SafetyMode.NORMAL
        self.safety_popup = None

    def _boot(self, seconds: float) -> None:
        self.robot_mode = RobotMode.BOOTING
        self._after(seconds, RobotMode.POWER_OFF)

    def _after(self, seconds: float, mode: RobotMode) -> None:
        self._due, self._next = self._now + seconds, mode
