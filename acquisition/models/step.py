"""The steps of a session, as values: `session.next_step` chooses one, and the step executor carries it out."""

from dataclasses import dataclass

from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import Shot, ShotKey


@dataclass(frozen=True)
class ChooseLights:
    """Choose the lights of a pass: the pilot's pattern, a fixed pattern, or the planned ones."""

    pass_number: int


@dataclass(frozen=True)
class AwaitReview:
    """Wait until a person has reviewed the lights of a pass, and perhaps replaced them."""

    pass_number: int


@dataclass(frozen=True)
class AwaitTarget:
    """Wait until a person has put the calibration target of a pass into the object's place."""

    pass_number: int


@dataclass(frozen=True)
class RepeatReference:
    """Take an image again, to verify that nothing has moved since. After an interruption it is an image captured before
    it; when a pass has all its images, it is the session's first."""

    shot: Shot
    key: ShotKey
    closes_pass: bool = False


@dataclass(frozen=True)
class PlanRoute:
    """Plan collision-free joint paths from the measured joints through the remaining lights, and home."""

    pass_number: int
    light_numbers: tuple[int, ...]


@dataclass(frozen=True)
class TakeShot:
    """Move along a waypoint's path and take its image."""

    key: ShotKey
    waypoint: Waypoint

    @property
    def light(self) -> ShotKey:
        """Key of the light, whose first frame this is."""
        return self.key


@dataclass(frozen=True)
class TakeScan:
    """Follow consecutive waypoints of a route and take the image of each as the arm arrives there."""

    shots: tuple[TakeShot, ...]

    @property
    def pass_number(self) -> int:
        """The pass that the images belong to."""
        return self.shots[0].key.pass_number


@dataclass(frozen=True)
class TakeFurther:
    """Take a further frame of a light, with the arm at the light's waypoint. `number` counts from 0."""

    key: ShotKey
    light: ShotKey
    number: int
    exposure_s: float
    waypoint: Waypoint


@dataclass(frozen=True)
class GoHome:
    """Follow a collision-free path home, so that the arm is out of the picture."""

    pass_number: int
    route: Route | None


@dataclass(frozen=True)
class TakeDark:
    """Take the lamp-off frame of one exposure time."""

    key: ShotKey
    exposure_s: float


@dataclass(frozen=True)
class SolveNormals:
    """Solve all images captured so far."""

    number: int


Step = (
    ChooseLights
    | AwaitReview
    | AwaitTarget
    | RepeatReference
    | PlanRoute
    | TakeShot
    | TakeScan
    | TakeFurther
    | GoHome
    | TakeDark
    | SolveNormals
)
