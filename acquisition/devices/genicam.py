"""Features of a GenICam camera that a previous program may have left switched on (names of the SFNC).

What bends the values (gamma, look-up tables) or the trigger (delays, triggers of bursts) is switched off. What shifts,
mirrors or shrinks the image is not: the calibration may have been made with it. It has to be stated in the cell file's
`settings`, or be off.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from acquisition.models.errors import ErrorCode, RigError

AUTOMATIC = ("ExposureAuto", "GainAuto", "BalanceWhiteAuto", "BlackLevelAuto")
"""Functions that change the values from image to image."""

SWITCHED_OFF = (
    *((name, "Off") for name in AUTOMATIC),
    ("GammaEnable", "false"), ("GammaEnabled", "false"), ("Gamma", "1"), ("LUTEnable", "false"), ("DigitalShift", "0"),
    ("ExposureMode", "Timed"), ("AcquisitionFrameRateEnable", "false"),
)  # fmt: skip
"""Features and the values that a linear image of one trigger needs."""

NEUTRAL = (
    ("ReverseX", "false"), ("ReverseY", "false"), ("BinningHorizontal", "1"), ("BinningVertical", "1"),
    ("DecimationHorizontal", "1"), ("DecimationVertical", "1"),
)  # fmt: skip
"""Features that move the pixels, and the values with which they do not."""

OFFSETS = ("OffsetX", "OffsetY")

_WORDS = {"true": 1.0, "false": 0.0}


class Features(Protocol):
    """Features of one camera by name, with values as text."""

    def readable(self, name: str) -> bool:
        """Whether the camera has the feature and states its value."""
        ...

    def writable(self, name: str) -> bool:
        """Whether the feature can be set now."""
        ...

    def get(self, name: str) -> str:
        """Returns the value."""
        ...

    def set(self, name: str, value: str) -> None:
        """Sets the value. Raises the library's error for one that the camera refuses."""
        ...

    def choices(self, name: str) -> Sequence[str]:
        """Returns the values of an enumeration."""
        ...


def reset(features: Features, settings: Mapping[str, str]) -> None:
    """Makes the cell file's `settings`, and switches off what bends the values; what is stated stays as stated.

    Raises RigError config.invalid for a setting that the camera does not have.
    """
    for name, value in SWITCHED_OFF:
        if name not in settings and features.writable(name) and not same(features.get(name), value):
            features.set(name, value)
    for name, value in settings.items():
        if name in OFFSETS:  # have to fit the size, which is set later
            continue
        if not features.writable(name):
            raise RigError(
                ErrorCode.CONFIG_INVALID, f"The camera has no feature {name} that can be set: see `settings`"
            )
        features.set(name, value)


def set_region(features: Features, width: int | None, height: int | None, settings: Mapping[str, str]) -> None:
    """Sets the size, from the sensor's upper left corner unless `settings` state an offset; leaves all unstated ones
    as they are if none is stated."""
    offsets = {name: settings[name] for name in OFFSETS if name in settings}
    if width is None and height is None and not offsets:
        return
    for name in OFFSETS:  # the size that fits depends on them
        if features.writable(name):
            features.set(name, "0")
    for name, side in (("Width", width), ("Height", height)):
        if side is not None:
            features.set(name, str(side))
    for name, offset in offsets.items():
        features.set(name, offset)


def set_trigger(features: Features, source: str) -> None:
    """Makes the frame trigger the only one: a camera also waits for any other that is on."""
    if features.writable("TriggerSelector"):
        for selector in features.choices("TriggerSelector"):
            features.set("TriggerSelector", selector)
            if features.writable("TriggerMode") and features.get("TriggerMode") != "Off":
                features.set("TriggerMode", "Off")
        features.set("TriggerSelector", "FrameStart")
    features.set("TriggerMode", "On")
    features.set("TriggerSource", source)
    if source != "Software" and features.writable("TriggerActivation"):
        features.set("TriggerActivation", "RisingEdge")
    for name in ("TriggerDelay", "TriggerDelayAbs"):
        if features.writable(name) and not same(features.get(name), "0"):
            features.set(name, "0")


def disagreements(features: Features, settings: Mapping[str, str]) -> list[str]:
    """Lists, as text for people, settings that the camera has not taken, and features that move the pixels unstated."""
    wrong = [
        f"{name}: {wanted} was set, but the camera reports {features.get(name)}"
        for name, wanted in settings.items()
        if not same(features.get(name), wanted)
    ]
    for name, neutral in (*NEUTRAL, *((name, "0") for name in OFFSETS)):
        if name not in settings and features.readable(name) and not same(features.get(name), neutral):
            value = _stated(features.get(name), neutral)
            wrong.append(
                f'{name} is {value}: if the calibration was made so, state `settings = {{ {name} = "{value}" }}`;'
                f" otherwise set it to {neutral} there, or in the maker's program"
            )
    return wrong


def report(features: Features, settings: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Returns the features of the fingerprint that the camera has, by name."""
    names = (*(name for name, _ in (*SWITCHED_OFF, *NEUTRAL)), *OFFSETS, "TriggerMode", "TriggerSource", *settings)
    return tuple((name, features.get(name)) for name in dict.fromkeys(names) if features.readable(name))


def same(value: str, other: str) -> bool:
    """Whether two values are the same, however they are written: 1 and 1.0, true and 1."""
    numbers = [_number(text) for text in (value, other)]
    return value == other if None in numbers else numbers[0] == numbers[1]


def _number(text: str) -> float | None:
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        return float(text)
    except ValueError:
        return None


def _stated(value: str, neutral: str) -> str:
    """Writes a value as its neutral one: booleans as words."""
    if neutral not in _WORDS:
        return value
    return "true" if _number(value) else "false"
