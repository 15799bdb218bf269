"""Results of checks of the calibration in use, and the age of these checks.

A check applies only to the calibration that was in use when it was made.
"""

from datetime import UTC, datetime
from typing import Annotated, Literal

from pydantic import Field

from acquisition.models.base import Value

DAILY_S = 86_400.0
"""Age of a check, s, above which another one is suggested."""

CheckTarget = Literal["board", "plane"]

_OF = {"board": "camera, arm and lens", "plane": "the lamp"}
"""The parts of the calibration that each target checks, as text for people."""


class PartTest(Value):
    """Test of one part of the calibration, by itself."""

    name: str = Field(description="`camera`, `board`, `joints`, `lens`; `intensity`, `lobe`, `lamp`")
    change: Annotated[tuple[float, ...], Field(strict=False)] = Field(
        description="Its most likely change, if it alone has changed: m and rad, pixels, or logarithms"
    )
    sigma: Annotated[tuple[float, ...], Field(strict=False)] = Field(description="1 σ of that")
    chi_square: float = Field(description="By how much that change lowers the weighted sum of squares")
    freedom: int = Field(description="Degrees of freedom")
    probability: float = Field(
        description="Probability that a correct calibration deviates as much by chance, in this part alone"
    )
    sentence: str = Field(description="The change for people")


class CheckedImage(Value):
    """Deviation of one image in a check."""

    image: str
    sha256: str
    deviation: float | None = Field(
        description="Deviation from what the calibration predicts: root mean square of the corners, pixels, or mean "
        "brightness, as a fraction; none: the target is not seen"
    )


class CheckResult(Value):
    """Result of a check of the calibration in use; `check.json`."""

    kind: Literal["check"] = "check"
    target: CheckTarget
    made_at: str
    version: str = Field(description="Version of the software")
    fingerprint: str = Field(description="SHA-256 of the calibration that was checked")
    passed: bool = Field(description="Whether it is still true")
    probability: float = Field(
        description="Probability that a correct calibration deviates as much by chance, corrected for the number of "
        "parts"
    )
    false_alarm: float = Field(description="Probability below which a part counts as changed")
    changed: Annotated[tuple[PartTest, ...], Field(strict=False)] = Field(
        description="What has changed, the most likely first; each tested with those before it free to change"
    )
    tests: Annotated[tuple[PartTest, ...], Field(strict=False)] = Field(description="All parts, each by itself")
    worst: str = Field(description="The image that deviates most")
    images: Annotated[tuple[CheckedImage, ...], Field(strict=False)]
    advice: Annotated[tuple[str, ...], Field(strict=False)] = Field(description="What to do next, for people")


class CheckRecord(Value):
    """The newest check with one target, as the journal records it."""

    session: str = Field(description="The session that made it")
    made_at: str = Field(description="When it was made, ISO 8601")
    fingerprint: str = Field(description="SHA-256 of the calibration that was checked")
    passed: bool = Field(description="Whether that was still true")
    probability: float = Field(description="Probability that a correct calibration deviates as much by chance")
    changed: Annotated[tuple[str, ...], Field(strict=False)] = Field(description="What had changed")
    sentences: Annotated[tuple[str, ...], Field(strict=False)] = Field(description="What was found, for people")


class CheckState(Value):
    """State of the calibration in use according to its checks."""

    checks: dict[CheckTarget, CheckRecord] = Field(
        default_factory=dict[CheckTarget, CheckRecord],
        description="The newest check of the calibration in use on each target: `board`, `plane`",
    )
    ages_h: dict[CheckTarget, float] = Field(
        default_factory=dict[CheckTarget, float], description="Hours since each of these"
    )
    warnings: list[str] = Field(
        default_factory=list[str],
        description="For people: not checked, not checked for a day, or found to be wrong; empty: all is well",
    )

    @property
    def sentence(self) -> str:
        """Result and age of the checks, in one line."""
        said = [
            f"{_OF[target]}: {'passed' if one.passed else 'not passed'} {self.ages_h[target]:.1f} h before"
            for target, one in self.checks.items()
        ]
        return "; ".join(said) or "never"


def state(recorded: dict[str, CheckRecord], fingerprint: str, now: datetime | None = None) -> CheckState:
    """Summarises the newest recorded check of each target for the calibration with this fingerprint."""
    moment = datetime.now(UTC) if now is None else now
    checks: dict[CheckTarget, CheckRecord] = {}
    ages_h: dict[CheckTarget, float] = {}
    warnings: list[str] = []
    targets: tuple[CheckTarget, ...] = ("board", "plane")
    for target in targets:
        known = recorded.get(target)
        if known is None or known.fingerprint != fingerprint:
            warnings.append(f"The calibration in use was never checked ({_OF[target]}); a daily check is suggested.")
            continue
        age_s = (moment - datetime.fromisoformat(known.made_at)).total_seconds()
        checks[target], ages_h[target] = known, round(age_s / 3600, 2)
        if not known.passed:
            warnings.append(f"The check at {known.made_at} contradicts the calibration: {'; '.join(known.sentences)}.")
        elif age_s > DAILY_S:
            warnings.append(
                f"The calibration in use was last checked {age_s / DAILY_S:.0f} days ago ({_OF[target]}); a daily "
                "check is suggested."
            )
    return CheckState(checks=checks, ages_h=ages_h, warnings=warnings)
