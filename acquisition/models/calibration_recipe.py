"""Recipes of calibration sessions: the part to calibrate, the target, the accuracy and the number of images.

A calibration session repeats the loop of a capture session (choose, route, capture, estimate) with poses in place of
lights. Its recipe states the same limits: the number of images of the first pass, the maximum number of images, and
the accuracy at which the session stops.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, cast

import numpy as np
from pydantic import Discriminator, Field, Tag, TypeAdapter, model_validator

from acquisition.models.base import Value
from acquisition.models.cell_config import Tool
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure, Recipe


class CalibrationRecipe(Value):
    """Fields common to the recipes of all calibration sessions."""

    tool: ClassVar[Tool]
    waits_for_targets: ClassVar[bool] = False
    max_images: int = Field(ge=6, le=120, description="Maximum number of images of the session")
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="Seed of the candidate poses")
    retakes: int = Field(default=4, ge=0, le=10, description="How often an image that was rejected is taken again")
    label: str = Field(default="", max_length=200, description="Title for people, up to 200 characters")
    notes: str = Field(default="", max_length=10_000, description="Notes for people, up to 10,000 characters")

    @property
    def first_images(self) -> int:
        """Number of images of the first pass, before which only the calibration in use is known."""
        return min(self.max_images, FIRST_IMAGES)

    @property
    def takes_darks(self) -> bool:
        """Whether a pass takes a lamp-off frame for each exposure time."""
        return False

    def images_after(self, taken: int) -> int:
        """Number of images of the pass that follows after `taken` images."""
        return self.first_images if taken == 0 else min(FURTHER_IMAGES, self.max_images - taken)

    @property
    def passes_most(self) -> int:
        """Maximum number of passes. The last one has no images if the accuracy has been reached."""
        return 1 + math.ceil((self.max_images - self.first_images) / FURTHER_IMAGES) + 1


FIRST_IMAGES, FURTHER_IMAGES = 8, 4
"""Numbers of images of the first pass and of each further one. Eight views determine all parameters. Each further pass
is planned from the estimate so far: an estimate after every four images takes a few seconds and saves moves."""


class BoardRecipe(CalibrationRecipe):
    """Recipe that calibrates the camera, or the camera and its pose in the base frame, with the board on the flange."""

    tool: ClassVar[Tool] = "board"
    kind: Literal["camera", "hand-eye"] = Field(
        description="`camera`: matrix and distortion; `hand-eye`: these and `base_from_camera`"
    )
    max_images: int = Field(default=20, ge=8, le=120, description="Maximum number of views of the board")
    target_px: float | None = Field(
        default=None,
        gt=0,
        le=10,
        description="Accuracy at which the session ends: 1 σ of a direction's place in the image, median, pixels",
    )
    target_mm: float | None = Field(
        default=None, gt=0, le=50, description="`hand-eye`: accuracy at which it ends, 1 σ of the camera's place, mm"
    )
    lit_by: Literal["room", "lamp"] = Field(
        default="room", description="What lights the board: the room, or the lamp where it stays on the flange"
    )
    exposure: Exposure = Field(default=Exposure(target=0.7), description="Exposure of the images")

    @model_validator(mode="after")
    def _place_is_for_hand_eye(self) -> "BoardRecipe":
        if self.kind == "camera" and self.target_mm is not None:
            raise ValueError("target_mm is the accuracy of the camera's place: it is for kind `hand-eye`")
        return self

    def images_after(self, taken: int) -> int:
        """Number of images of the next pass. Without a target accuracy, the second pass takes all that remain, because
        an estimate in between would save no moves."""
        ordered = self.target_px is not None or self.target_mm is not None
        left = self.max_images - taken
        return self.first_images if taken == 0 else min(FURTHER_IMAGES, left) if ordered else left

    @property
    def lit(self) -> bool:
        """Whether the lamp is on while a frame is exposed."""
        return self.lit_by == "lamp"


class LampRecipe(CalibrationRecipe):
    """Recipe that calibrates the lamp: first its position on a mirror sphere, then intensity and lobe on a matt plane.

    The first pass captures the sphere, each further pass one placing of the plane. Before each further pass the session
    waits until the target is in place. With two or more placings, the last one is not fitted but verifies the result.
    """

    tool: ClassVar[Tool] = "lamp"
    waits_for_targets: ClassVar[bool] = True
    kind: Literal["lamp"] = Field(description="`lamp`: `tool_from_lamp`, `lamp_intensity` and `lobe`")
    max_images: int = Field(default=72, ge=36, le=120, description="Images of sphere and plane together")
    sphere_share: float = Field(default=0.45, ge=0.25, le=0.7, description="Share of these that show the sphere")
    placings: int = Field(
        default=2, ge=1, le=4, description="How often the plane is laid down, each time in another place"
    )
    exposure: Exposure = Field(default=Exposure(target=0.7), description="Exposure of the images of the plane")

    @property
    def takes_darks(self) -> bool:
        """True: lamp-off frames remove the room's light on the plane."""
        return True

    @property
    def first_images(self) -> int:
        """Number of images of the sphere."""
        return round(self.sphere_share * self.max_images)

    @property
    def placing_images(self) -> int:
        """Number of images of each placing of the plane."""
        return (self.max_images - self.first_images) // self.placings

    def images_after(self, taken: int) -> int:
        """Number of images of the next pass: those of the sphere first, then those of each placing."""
        if taken == 0:
            return self.first_images
        return self.placing_images if taken < self.first_images + self.placings * self.placing_images else 0

    @property
    def passes_most(self) -> int:
        """One pass for the sphere and one for each placing."""
        return 1 + self.placings

    @model_validator(mode="after")
    def _plane_has_images(self) -> "LampRecipe":
        if self.placing_images < LEAST_OF_A_PLACING:
            raise ValueError(
                f"that leaves {self.placing_images} images for each placing, but {LEAST_OF_A_PLACING} are needed: "
                "raise max_images, or lower placings or sphere_share"
            )
        return self


LEAST_OF_A_PLACING = 10
"""Minimum number of images of one placing of the plane. Fewer do not separate lobe, tilt and flat field."""


@dataclass(frozen=True)
class FrameSetting:
    """Setting of one frame of a response session. `share` is the exposure time divided by that at which the brightest
    parts are full; `lit`: the lamp is on."""

    share: float
    lit: bool


class OnePassRecipe(CalibrationRecipe):
    """Recipe that takes all images in one pass: no estimate from earlier images chooses later ones."""

    @property
    def first_images(self) -> int:
        """All images."""
        return self.max_images

    @property
    def passes_most(self) -> int:
        """One pass."""
        return 1


class ResponseRecipe(OnePassRecipe):
    """Recipe that measures the camera's response at one light with the arm at rest: black level, gain, noise, full well
    and linearity."""

    tool: ClassVar[Tool] = "lamp"
    kind: Literal["response"] = Field(
        description="`response`: the camera's black level, gain, noise, full well and linearity"
    )
    max_images: int = Field(
        default=49, ge=25, le=101, description="Images: one, and four for each exposure time, of which two without lamp"
    )
    exposure: Exposure = Field(default=Exposure(target=0.7), description="Exposure by which the others are set")

    @property
    def frames(self) -> tuple[FrameSetting, ...]:
        """Settings of the images in the order of capture. The first has the recipe's exposure. The others are in random
        order, so that the drift of a lamp that warms up does not appear as nonlinearity."""
        count = (self.max_images - 1) // 4
        shares = [LONGEST_SHARE * ((step + 1) / count) ** 1.5 for step in range(count)]
        ordered = [FrameSetting(share, lit) for share in shares for lit in (True, True, False, False)]
        lot = np.random.default_rng(self.seed).permutation(len(ordered))
        return (FrameSetting(self.exposure.target, True), *(ordered[number] for number in lot))


LONGEST_SHARE = 1.5
"""Longest exposure time of a response session, divided by that at which the brightest parts are full. It exceeds 1,
because the full well shows only in pixels that are full."""


class CheckRecipe(OnePassRecipe):
    """Recipe that checks with few images whether the calibration in use is still true. It changes nothing."""

    tool: ClassVar[Tool] = "board"
    kind: Literal["check"] = Field(
        description="`check`: whether the calibration in use is still true, and what has moved if not"
    )
    target: Literal["board", "plane"] = Field(
        default="board",
        description="`board`: on the flange, for camera, arm and lens; `plane`: the matt plane in the object's place "
        "and the lamp on the flange, for the lamp",
    )
    max_images: int = Field(default=8, ge=6, le=24, description="Images")
    exposure: Exposure = Field(default=Exposure(target=0.7), description="Exposure of the images")

    @property
    def takes_darks(self) -> bool:
        """Whether lamp-off frames are taken: for the plane, to remove the room's light on it."""
        return self.target == "plane"

    @property
    def lit(self) -> bool:
        """Whether the lamp is on while a frame is exposed: it lights the plane, the room lights the board."""
        return self.target == "plane"

    @property
    def lit_by(self) -> Literal["room", "lamp"]:
        """What lights the target."""
        return "lamp" if self.lit else "room"


TAGS = ("capture-recipe", "board-recipe", "lamp-recipe", "response-recipe", "check-recipe")
"""Tags that name the kind of recipe in the location of a validation error, beside the names of fields."""


def _kind(recipe: object) -> str | None:
    given = cast(dict[str, Any], recipe) if isinstance(recipe, dict) else None
    kind = given.get("kind", "capture") if given is not None else getattr(recipe, "kind", "capture")
    return {
        "camera": "board-recipe", "hand-eye": "board-recipe", "lamp": "lamp-recipe", "response": "response-recipe",
        "check": "check-recipe",
        "capture": "capture-recipe",
    }.get(str(kind))  # fmt: skip


AnyRecipe = Annotated[
    Annotated[Recipe, Tag("capture-recipe")]
    | Annotated[BoardRecipe, Tag("board-recipe")]
    | Annotated[LampRecipe, Tag("lamp-recipe")]
    | Annotated[ResponseRecipe, Tag("response-recipe")]
    | Annotated[CheckRecipe, Tag("check-recipe")],
    Discriminator(
        _kind,
        custom_error_type="kind",
        custom_error_message="`kind` must be capture, camera, hand-eye, lamp, response or check; default: capture",
    ),
]
"""Recipe of a session of any kind. A recipe without `kind` is a capture recipe."""

_ANY: TypeAdapter[AnyRecipe] = TypeAdapter(AnyRecipe)


def read(content: str) -> AnyRecipe:
    """Reads a recipe of any kind from JSON."""
    return _ANY.validate_json(content)


def require_capture(recipe: AnyRecipe) -> Recipe:
    """Returns a recipe of a capture session. Raises RigError session.action_not_allowed for one of a calibration."""
    if isinstance(recipe, Recipe):
        return recipe
    raise RigError(
        ErrorCode.SESSION_ACTION_NOT_ALLOWED,
        f"A session of kind {recipe.kind} has no lights and no normals",
        allowed=[],
    )


def tool_of(recipe: AnyRecipe) -> Tool:
    """Returns the tool that a session needs on the flange."""
    if isinstance(recipe, Recipe) or (isinstance(recipe, CheckRecipe) and recipe.target == "plane"):
        return "lamp"
    return recipe.tool
