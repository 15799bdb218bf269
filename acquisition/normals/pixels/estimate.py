"""The solution at some pixels, as the pixel solve returns it and all later steps read it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatT
from acquisition.normals.pixels import image_terms
from acquisition.normals.pixels.image_terms import ImageTerms, TermValues


@dataclass(frozen=True)
class Estimate:
    """The solution at N pixels, with the measurements, weights and light vectors that it was solved with."""

    g: Float32Array  # (3, N) albedo × normal, view frame
    variance: Float32Array  # (N,) rad², both tangential directions
    residual: Float32Array  # (N,) rms of whitened residuals
    weights: Float32Array  # (F, N) robust weight / variance, 0 where not usable
    usable: BoolArray  # (F, N)
    light: Float32Array  # (F, 3, N) light vectors s
    point: Float32Array  # (3, N) m, view frame
    response: Float32Array | None = None  # (N,) values of white at a mosaic's sites over their mean; none: no mosaic
    sky: Float32Array | None = None  # (N,) sky view factor of the pixels; none: the whole sky
    terms: TermValues | None = None  # those beyond Lambert's, as solved with; none: there are none

    def lambertian(self, dtype: type[FloatT] = np.float32) -> npt.NDArray[FloatT]:
        """s · g (F, N), Lambert's law without its bound at zero."""
        return np.einsum("fcn,cn->fn", self.light, self.g, dtype=dtype)

    def predicted(self, dtype: type[FloatT] = np.float32) -> npt.NDArray[FloatT]:
        """Values (F, N) by the solution: s · g, and what the terms beyond Lambert's contribute."""
        return np.asarray(self.lambertian(dtype) + self.term_value, dtype)

    @property
    def rows(self) -> Float32Array:
        """Design rows (F, 3, N): derivatives s + ∂h/∂g of the values by g, h being the terms beyond Lambert's."""
        return self.light if self.terms is None else self.light + self.terms.by_g

    @property
    def by_lamps(self) -> Float32Array:
        """The part of the values (F, N) that scales with the lamps' intensities: all but ambient light and offset."""
        return self.lambertian() if self.terms is None else self.lambertian() + self.terms.from_lamps

    @property
    def term_value(self) -> Float32Array | np.float32:
        """Contribution of the terms beyond Lambert's to the values (F, N); 0 without any."""
        return np.float32(0) if self.terms is None else self.terms.value

    def evaluated(self, terms: ImageTerms) -> TermValues:
        """`image_terms.evaluate` at the solution."""
        view = photometry.towards_camera(self.point)
        return image_terms.evaluate(terms, self.g, self.light, self.usable, view, self.response, self.sky)

    def by_parameter(self, terms: ImageTerms) -> Float32Array:
        """`image_terms.by_parameter` (F, 6, N) at the solution."""
        view = photometry.towards_camera(self.point)
        return image_terms.by_parameter(terms, self.g, self.light, self.usable, view, self.response, self.sky)

    @property
    def highlight_variance(self) -> Float32Array | np.float32:
        """Variance (F, N) of the highlights among the terms; 0 without any."""
        return np.float32(0) if self.terms is None else self.terms.highlight_variance

    @property
    def beside_direct_diffuse(self) -> Float32Array | np.float32:
        """The part of the values (F, N) that is not the lamps' light reflected diffusely: highlights, offset and
        reflected ambient light; 0 without terms."""
        return np.float32(0) if self.terms is None else self.terms.nondiffuse + self.terms.ambient

    @property
    def nondiffuse_value(self) -> Float32Array | np.float32:
        """`TermValues.nondiffuse` (F, N), light that other surfaces do not receive alike; 0 without terms."""
        return np.float32(0) if self.terms is None else self.terms.nondiffuse

    @property
    def albedo(self) -> Float32Array:
        """Albedo (N,)."""
        return np.sqrt(np.sum(self.g * self.g, axis=0))

    @property
    def normals(self) -> Float32Array:
        """Unit normals (3, N), view frame."""
        return (self.g / np.maximum(self.albedo, 1e-9)).astype(np.float32)
