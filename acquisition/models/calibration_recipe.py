"""Recipes of calibration sessions: which part of the calibration, on which target, how accurate, with how many images.

A calibration session repeats the loop of a capture session (choose, route, capture, estimate) with poses in place of
lights, so its recipe states the same limits: how many images a pass begins with, how many there may be, and the
accuracy at which it stops.
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
    """What the recipes of all calibration sessions have."""

    tool: ClassVar[Tool]
    waits_for_targets: ClassVar[bool] = False
    max_images: int = Field(ge=6, le=120, description="Most images of the session")
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="Seed of the candidate poses")
    retakes: int = Field(default=4, ge=0, le=10, description="How often an image that was rejected is taken again")
    label: str = Field(default="", max_length=200, description="Title for people, up to 200 characters")
    notes: str = Field(default="", max_length=10_000, description="Notes for people, up to 10,000 characters")

    @property
    def first_images(self) -> int:
        """Images of the first pass, before which nothing but the calibration in use is known."""
        return min(self.max_images, FIRST_IMAGES)

    @property
    def takes_darks(self) -> bool:
        """Whether each exposure time of a pass has a lamp-off image."""
        return False

    def images_after(self, taken: int) -> int:
        """Images of the pass that follows on `taken` images."""
        return self.first_images if taken == 0 else min(FURTHER_IMAGES, self.max_images - taken)

    @property
    def passes_most(self) -> int:
        """Number of passes at most, the last without images where the accuracy has been reached."""
        return 1 + math.ceil((self.max_images - self.first_images) / FURTHER_IMAGES) + 1


FIRST_IMAGES, FURTHER_IMAGES = 8, 4
"""Images of the first pass and of each further one, which is planned from the estimate so far: eight views determine
all parameters, and an estimate after every four costs a few seconds for the moves that it saves."""


class BoardRecipe(CalibrationRecipe):
    """Camera, or camera and its place in the arm's base frame, from the board on the flange."""

    tool: ClassVar[Tool] = "board"
    kind: Literal["camera", "hand-eye"] = Field(
        description="`camera`: matrix and distortion; `hand-eye`: these and `base_from_camera`"
    )
    max_images: int = Field(default=20, ge=8, le=120, description="Most views of the board")
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
        """As many as there are, where all are taken anyway: an estimate in between would save no move."""
        ordered = self.target_px is not None or self.target_mm is not None
        left = self.max_images - taken
        return self.first_images if taken == 0 else min(FURTHER_IMAGES, left) if ordered else left

    @property
    def lit(self) -> bool:
        """Whether the lamp is on while a frame is exposed."""
        return self.lit_by == "lamp"


class LampRecipe(CalibrationRecipe):
    """The lamp's place from a mirror sphere, then its intensity and lobe from a matt plane, laid down once or more.

    The first pass is the sphere's, each other one a placing of the plane; between them the session waits for the next
    target. The last placing of two or more takes no part and verifies the result.
    """

    tool: ClassVar[Tool] = "lamp"
    waits_for_targets: ClassVar[bool] = True
    kind: Literal["lamp"] = Field(description="`lamp`: `tool_from_lamp`, `lamp_intensity` and `lobe`")
    max_images: int = Field(default=72, ge=36, le=120, description="Images of sphere and plane together")
    sphere_share: float = Field(default=0.45, ge=0.25, le=0.7, description="Share of these that show the sphere")
    placings: int = Field(default=2, ge=1, le=4, description="How often the plane is laid down, each time otherwise")
    exposure: Exposure = Field(default=Exposure(target=0.7), description="Exposure of the images of the plane")

    @property
    def takes_darks(self) -> bool:
        """The room's light on the plane is taken out."""
        return True

    @property
    def first_images(self) -> int:
        """Images of the sphere."""
        return round(self.sphere_share * self.max_images)

    @property
    def placing_images(self) -> int:
        """Images of each placing of the plane."""
        return (self.max_images - self.first_images) // self.placings

    def images_after(self, taken: int) -> int:
        """The sphere's images, then those of a placing."""
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
            raise ValueError(f"that leaves {self.placing_images} images a placing: {LEAST_OF_A_PLACING} are needed")
        return self


LEAST_OF_A_PLACING = 10
"""Images of one placing of the plane: fewer do not tell lobe, sides and flat field apart."""


@dataclass(frozen=True)
class FrameSetting:
    """One frame of a response session: its exposure time over that at which the brightest parts are full, and whether
    the lamp is on."""

    share: float
    lit: bool


class OnePassRecipe(CalibrationRecipe):
    """All images in one pass: none is chosen by an estimate from those before it."""

    @property
    def first_images(self) -> int:
        """All."""
        return self.max_images

    @property
    def passes_most(self) -> int:
        """One."""
        return 1


class ResponseRecipe(OnePassRecipe):
    """The camera's response (black level, gain, noise, full well, linearity) at one light with the arm at rest."""

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
        """The settings of the images in the order of capture: the first at the recipe's exposure, the others by lot, so
        that a lamp that warms up is no bend of the response."""
        count = (self.max_images - 1) // 4
        shares = [LONGEST_SHARE * ((step + 1) / count) ** 1.5 for step in range(count)]
        ordered = [FrameSetting(share, lit) for share in shares for lit in (True, True, False, False)]
        lot = np.random.default_rng(self.seed).permutation(len(ordered))
        return (FrameSetting(self.exposure.target, True), *(ordered[number] for number in lot))


LONGEST_SHARE = 1.5
"""Longest exposure time of a response session, over that at which the brightest parts are full: pixels have to be full
for their full well to be seen."""


class CheckRecipe(OnePassRecipe):
    """Few images that tell whether the calibration in use is still true; it changes nothing."""

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
        """The room's light on the plane is taken out."""
        return self.target == "plane"

    @property
    def lit(self) -> bool:
        """The board is lit by the room, the plane by the lamp."""
        return self.target == "plane"

    @property
    def lit_by(self) -> Literal["room", "lamp"]:
        """What lights the target."""
        return "lamp" if self.lit else "room"


TAGS = ("capture-recipe", "board-recipe", "lamp-recipe", "response-recipe", "check-recipe")
"""What an error's location names beside the fields: which of the recipes was read."""


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
        custom_error_message="`kind` is one of capture, camera, hand-eye, lamp, response, check; without it capture",
    ),
]
"""The recipe of a session of any kind; without `kind` it is one of capture."""

_ANY: TypeAdapter[AnyRecipe] = TypeAdapter(AnyRecipe)


def read(content: str) -> AnyRecipe:
    """A recipe of any kind from its JSON."""
    return _ANY.validate_json(content)


def require_capture(recipe: AnyRecipe) -> Recipe:
    """The recipe of a capture session. Raises RigError session.action_not_allowed for one of calibration."""
    if isinstance(recipe, Recipe):
        return recipe
    raise RigError(
        ErrorCode.SESSION_ACTION_NOT_ALLOWED,
        f"A session of kind {recipe.kind} has no lights and no normals",
        allowed=[],
    )


def tool_of(recipe: AnyRecipe) -> Tool:
    """What is on the flange during a session."""
    if isinstance(recipe, Recipe) or (isinstance(recipe, CheckRecipe) and recipe.target == "plane"):
        return "lamp"
    return recipe.tool
