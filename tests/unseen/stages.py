"""Switches of the near solver's stages: the description of each stage, and the patches that switch it off.

A switch replaces constants or functions of the solver's modules while its context lasts, and nothing else. All other
stages run unchanged, without the effect of this one. A stage is off if its result is the solver's starting value
(nominal lamps, flat depth, stated noise), or if it passes on its input.
"""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import ModuleType

from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.result import SolveSettings
from acquisition.normals import self_calibration
from acquisition.normals.alternatives import model_selection, term_alternatives
from acquisition.normals.alternatives.alternative import Alternative
from acquisition.normals.indirect_light import shadow_light
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.pixel_solve import Estimate
from acquisition.normals.self_calibration import Priors, SharedParameters
from acquisition.normals.surface import discontinuity, integrability, integration, local_regression, markov_field
from acquisition.normals.uncertainty import error_variance, residual_noise
from acquisition.normals.uncertainty.error_variance import ErrorVariance


@dataclass(frozen=True)
class Patch:
    """A name in a module, and its replacement."""

    module: ModuleType
    name: str
    value: object

    @property
    def target(self) -> str:
        """Dotted name of the replaced object."""
        changed = "" if self.name != "SETTINGS" else f".{self._field()}"
        return f"{self.module.__name__}.{self.name}{changed}"

    def _field(self) -> str:
        """The field in which settings differ."""
        usual, present = vars(getattr(self.module, self.name)), vars(self.value)
        return ", ".join(name for name, value in present.items() if value != usual[name])


@dataclass(frozen=True)
class Captures:
    """Captures that show a stage: reflectance (None: the object's own), fault (None: none), seeds (none: the run's)."""

    reflectance: str | None = None
    fault: str | None = None
    seeds: tuple[int, ...] = ()

    def __str__(self) -> str:
        seeds = "seeds " + ", ".join(map(str, self.seeds)) if self.seeds else None
        return ", ".join(part for part in (self.reflectance, self.fault, seeds) if part)


@dataclass(frozen=True)
class Stage:
    """A stage, one sentence on the solver `without` it, the patches or settings that switch it off, and the captures on
    which it is compared, if only some show it."""

    name: str
    without: str
    patches: tuple[Patch, ...] = ()
    settings: SolveSettings | None = None
    captures: Captures | None = None


@contextmanager
def off(stage: Stage) -> Generator[None]:
    """Applies the stage's patches within the context and always undoes them. Raises AttributeError for a name that does
    not exist."""
    before = [getattr(patch.module, patch.name) for patch in stage.patches]
    try:
        for patch in stage.patches:
            setattr(patch.module, patch.name, patch.value)
        yield
    finally:
        for patch, value in zip(stage.patches, before, strict=True):
            setattr(patch.module, patch.name, value)


def _setting(module: ModuleType, **value: float) -> Patch:
    """A module's settings with another value of a field."""
    return Patch(module, "SETTINGS", replace(module.SETTINGS, **value))


_gauss_newton_step = self_calibration.gauss_newton_step


def _holding(**sigma: float) -> Patch:
    """Patches the Gauss–Newton step of the shared parameters: a prior's 1 σ of zero holds its parameter."""

    def step(
        estimate: Estimate, by_depth: Float32Array, values: Float32Array, lamps: Float32Array,
        present: SharedParameters, priors: Priors, *rest: object,
    ) -> SharedParameters:  # fmt: skip
        return _gauss_newton_step(estimate, by_depth, values, lamps, present, replace(priors, **sigma), *rest)  # type: ignore[arg-type]

    return Patch(self_calibration, "gauss_newton_step", step)


def _stated_noise(solution: Estimate, values: Float32Array, noise: Noise, stated: Noise, *_: object) -> Noise:
    """Replaces `residual_noise.estimate`."""
    return stated


def _unchanged(*_: object) -> float:
    """Replaces functions that change their arguments and return the factor by which the noise falls."""
    return 1.0


def _no_shadows(*_: object) -> ShadowEquations:
    """Replaces `shadow_light.equations`."""
    return ShadowEquations.none()


def _start_depth(
    normals: Float32Array, mask: BoolArray, ray: Float32Array, confidence: Float32Array, start_m: Float32Array,
    **_: object,
) -> Float32Array:  # fmt: skip
    """Replaces `integration.depth`."""
    return start_m.copy()


def _no_discontinuity(*_: object) -> None:
    """Replaces `discontinuity.discontinuous_depth`, as if no shadow contradicted the depth."""


def _not_shown(*_: object) -> bool:
    """Replaces `shadow_light.shadows_show_indirect`."""
    return False


def _no_alternative(*_: object) -> list[Alternative]:
    return []


def _posterior_sigma(posterior_deg: Float32Array, *_: object, **__: object) -> ErrorVariance:
    """Replaces `error_variance.evaluate`."""
    return ErrorVariance(posterior_deg, typical_excess=0.0, misfit=1.0, structure_deg=0.0)


OPAQUE = tuple(one for one in model_selection.ALTERNATIVES if one is not term_alternatives.translucent_surface)
"""All alternatives except that of a translucent surface."""

NO_DISCONTINUITY = Patch(discontinuity, "discontinuous_depth", _no_discontinuity)

STAGES = (
    Stage(
        "self-calibration of intensities",
        "Lamps are as bright as the calibration says; places and shift are still estimated.",
        (_holding(intensity=0.0),),
    ),
    Stage(
        "lamps' places",
        "Lamps are where the calibration says; intensities and shift are still estimated.",
        (_holding(position_m=0.0),),
    ),
    Stage(
        "the object's shift",
        "The object's mean depth is the caller's rough one.",
        (_holding(shift_m=0.0),),
    ),
    Stage(
        "self-calibration as a whole",
        "Intensities, lamps' places and the object's shift are all held.",
        (_holding(intensity=0.0, position_m=0.0, shift_m=0.0),),
    ),
    Stage(
        "interreflection",
        "Indirect light is never significant, so that none is subtracted and none is in σ.",
        (Patch(shadow_light, "shadows_show_indirect", _not_shown),),
    ),
    Stage(
        "noise from residuals",
        "The shares c and σ_d of the noise are those of the calibration.",
        (Patch(residual_noise, "estimate", _stated_noise),),
    ),
    Stage(
        "integrability projection",
        "Normals stay as pixels have them; σ is not lowered for it.",
        (Patch(integrability, "project_integrable", _unchanged),),
    ),
    Stage(
        "regression on neighbours",
        "Normals stay as the projection leaves them; σ is not lowered for it.",
        (Patch(local_regression, "regress", _unchanged),),
    ),
    Stage(
        "Markov random field",
        "Uncertain normals stay as their own images tell them; σ is not lowered for it.",
        (Patch(markov_field, "regularise", _unchanged),),
    ),
    Stage(
        "ambient and stray light in shadows",
        "Lit pixels alone tell of ambient and stray light.",
        (Patch(shadow_light, "equations", _no_shadows),),
        captures=Captures("lambert", "ambient:0.03"),
    ),
    Stage(
        "Cauchy weights",
        "Pixels are solved by least squares (recipe's `robust` off).",
        settings=SolveSettings(robust=False),
    ),
    Stage(
        "half-shadow variance",
        "Measurements beside shadows count as surely as others.",
        (_setting(pixel_solve, penumbra_sigma=0.0),),
    ),
    Stage(
        "depth discontinuities",
        "Depth is integrated from normals alone; cast shadows give no equations.",
        (NO_DISCONTINUITY,),
    ),
    Stage(
        "depth integration",
        "The object stays flat at its rough depth; its shift is estimated, and there are no discontinuities.",
        (Patch(integration, "depth", _start_depth), NO_DISCONTINUITY),
    ),
    Stage(
        "low shadow threshold",
        "What is below 15 % of a pixel's peak counts as shadow.",
        settings=SolveSettings(shadow_threshold=0.15),
    ),
    Stage(
        "model selection",
        "The plain model is kept, whatever tests demand; what they find is still named, and in σ.",
        (Patch(model_selection, "ALTERNATIVES", ()),),
    ),
    Stage(
        "gloss",
        "A glossy surface is solved as a diffuse one, whatever the score test says.",
        (Patch(term_alternatives, "gloss", _no_alternative),),
    ),
    Stage(
        "metal",
        "A surface without diffuse light is solved as a diffuse one.",
        (Patch(term_alternatives, "metal", _no_alternative),),
        captures=Captures("metal:0.3"),
    ),
    Stage(
        "translucent surfaces",
        "Images are not sharpened, whatever light is in cast shadows; σ follows detail all the same.",
        (Patch(model_selection, "ALTERNATIVES", OPAQUE),),
        captures=Captures(seeds=(45, 55, 65)),
    ),
    Stage(
        "variance components of σ",
        "σ is that of the posterior, lowered by the projection.",
        (Patch(error_variance, "evaluate", _posterior_sigma),),
    ),
)
"""The stages of the near solver that the bench's captures reach. Sensor and pixel noise are not among them, because the
bench states the sensor's true noise, so neither `sensor_estimate` nor `pixel_noise` is reached."""
