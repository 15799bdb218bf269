"""Joint fit of normal and BRDF per pixel: a diffuse term and GGX lobes with non-negative strengths.

A camera near the lights' axis sees angles between half vector and light below 30°. There Fresnel's factor is constant,
and the reflectance of an isotropic material is a function of n·l, n·h and n·v only. Its specular part is a non-negative
sum of lobes in n·h of fixed roughness, which represents short and long tails of real lobes. So for a given normal the
model is linear in non-negative strengths, and only the two tangential directions of the normal have to be searched:
variable projection (Golub & Pereyra 1973, Kaufman 1975) with Levenberg–Marquardt.

The fall-off of the diffuse term with n·l cannot be fitted in each pixel, because it is not separable from a tilt of the
normal. All pixels of an object share its form (`reflectance_fit`).
"""

import numba
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals.pixels import pixel_solve_kernels
from acquisition.photometry import GAUSSIAN_MEDIAN_DEVIATION

GGX_ROUGHNESS = np.array([0.08, 0.16, 0.32, 0.64])
"""GGX roughness α of the lobes, in octaves."""

BASIS_SIZE = 1 + len(GGX_ROUGHNESS)
"""Number of basis functions: the diffuse term and the lobes."""

DIFFERENCE_STEP = 1e-4
"""Change of the normal (rad) for difference quotients."""


@numba.njit(
    "void(float64[::1], float64[:,::1], float64[::1], float64[::1], float64[:,::1])",
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def basis(
    normal: FloatArray,  # (3,)
    light: FloatArray,  # (6, F) direction, then half vector
    diffuse_form: FloatArray,  # (2,) κ and ω
    roughness: FloatArray,  # (K − 1,)
    out: FloatArray,  # (K, F)
) -> None:
    """Evaluates the diffuse term and the GGX lobes at a normal under each light, all of about unit height.

    The diffuse term is x (1 − κ (1 − x/2)⁵) + ω x s/max(x, n·v), x = n·l: κ = 1 is the diffuse light that leaves a
    smooth dielectric (Ashikhmin & Shirley 2000), ω the flattening by rough relief (Oren & Nayar 1994, in Fujii's form).
    Lobes are GGX with Smith's shadowing (Walter et al. 2007).
    """
    one = 1.0
    kappa, omega = diffuse_form[0], diffuse_form[1]
    nv = max(normal[2], 0.02)
    for f in range(light.shape[1]):
        x = normal[0] * light[0, f] + normal[1] * light[1, f] + normal[2] * light[2, f]
        h = normal[0] * light[3, f] + normal[1] * light[4, f] + normal[2] * light[5, f]
        inside = one if x > 0 else 0.0
        x = max(x, 1e-6)
        fall = one - 0.5 * x
        fall2 = fall * fall
        s = light[2, f] - x * normal[2]
        diffuse = x * (one - kappa * fall2 * fall2 * fall)
        diffuse += omega * x * max(s, 0.0) / max(x, nv)
        out[0, f] = inside * diffuse
        h2 = h * h
        for k in range(len(roughness)):
            a2 = roughness[k] * roughness[k]
            d = a2 / (h2 * (a2 - one) + one)
            out[k + 1, f] = inside * d * d * 2 * x / (x + np.sqrt(a2 + (one - a2) * x * x))


@numba.njit(
    "float64(float64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[::1])",
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def non_negative_least_squares(
    values: FloatArray,  # (F,)
    weights: FloatArray,  # (F,)
    basis_values: FloatArray,  # (K, F)
    normal_matrix: FloatArray,  # (K, K) out
    right: FloatArray,  # (K,) out
    solution: FloatArray,  # (K,) start in, result out
) -> float:
    """Weighted non-negative least squares by coordinate descent on the normal equations; returns the squared error."""
    count, size = basis_values.shape
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for f in range(size):
                total += weights[f] * basis_values[i, f] * basis_values[j, f]
            normal_matrix[i, j] = total
            normal_matrix[j, i] = total
        total = 0.0
        for f in range(size):
            total += weights[f] * basis_values[i, f] * values[f]
        right[i] = total
    for _ in range(60):
        change = 0.0
        for i in range(count):
            residual = right[i]
            for j in range(count):
                residual -= normal_matrix[i, j] * solution[j]
            new = max(solution[i] + residual / (normal_matrix[i, i] + 1e-12), 0.0)
            change = max(change, abs(new - solution[i]))
            solution[i] = new
        if change < 1e-5:
            break
    error = 0.0
    for f in range(size):
        residual = values[f]
        for i in range(count):
            residual -= solution[i] * basis_values[i, f]
        error += weights[f] * residual * residual
    return error


@numba.njit(
    "void(float64[::1], float64[:,::1], float64[::1], float64[::1])", cache=True, fastmath=True, error_model="numpy"
)
def _residuals(values: FloatArray, basis_values: FloatArray, strengths: FloatArray, out: FloatArray) -> None:
    """Values (F,) less those of the basis (K, F) with strengths (K,), into `out` (F,)."""
    out[:] = values
    for k in range(len(strengths)):
        for f in range(len(values)):
            out[f] -= strengths[k] * basis_values[k, f]


@numba.njit("float64(float64[::1], float64[::1], float64)", cache=True, fastmath=True, error_model="numpy")
def _cauchy_loss(residual: FloatArray, weights: FloatArray, squared: float) -> float:
    """Sum of Cauchy's loss s ln(1 + w r²/s) for a squared scale s."""
    loss = 0.0
    for f in range(len(residual)):
        loss += squared * np.log1p(residual[f] * residual[f] * weights[f] / squared)
    return loss


@numba.njit("void(float64[::1], float64[:,::1])", cache=True, error_model="numpy")
def _tangents(normal: FloatArray, out: FloatArray) -> None:
    """Two orthogonal unit tangents of a unit normal, as rows of `out` (2, 3)."""
    if abs(normal[0]) < 0.8:
        out[0, 0], out[0, 1], out[0, 2] = 0.0, normal[2], -normal[1]
    else:
        out[0, 0], out[0, 1], out[0, 2] = -normal[2], 0.0, normal[0]
    length = np.sqrt(out[0, 0] ** 2 + out[0, 1] ** 2 + out[0, 2] ** 2)
    for i in range(3):
        out[0, i] /= length
    out[1, 0] = normal[1] * out[0, 2] - normal[2] * out[0, 1]
    out[1, 1] = normal[2] * out[0, 0] - normal[0] * out[0, 2]
    out[1, 2] = normal[0] * out[0, 1] - normal[1] * out[0, 0]


@numba.njit("void(float64[::1], float64[:,::1], float64, float64, float64[::1])", cache=True, error_model="numpy")
def _perturbed(normal: FloatArray, tangent: FloatArray, first: float, second: float, out: FloatArray) -> None:
    """Displaces a normal by two tangential amounts (rad), still facing the camera (n_z ≥ 0.02 before normalisation)."""
    for i in range(3):
        out[i] = normal[i] + first * tangent[0, i] + second * tangent[1, i]
    out[2] = max(out[2], 0.02)
    length = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    for i in range(3):
        out[i] /= length


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float64[:,::1], float64[::1], float64[::1], float64[::1],"
    " float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], int64)",
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _fit_pixel(  # noqa: PLR0912, PLR0915 - one fused kernel is the point
    values: Float32Array,  # (N, F), of about unit height
    weights: Float32Array,  # (N, F) weights of the measurements; 0: not used
    light: FloatArray,  # (6, F)
    diffuse_form: FloatArray,  # (2,) κ and ω
    roughness: FloatArray,  # (K − 1,)
    scalars: FloatArray,  # Cauchy scale in units of the residuals' spread, least spread, iterations, ring in rad
    start: Float32Array,  # (N, 3) normals
    normals: Float32Array,  # (N, 3) out
    strengths: Float32Array,  # (N, K) out: strengths
    statistics: Float32Array,  # (N, 3) out: loss, spread of residuals, variance in rad² over both tangential directions
    p: int,
) -> None:
    """Fits pixel p, see `fit`."""
    size = values.shape[1]
    count = len(roughness) + 1
    cauchy, least, iterations, ring = scalars[0], scalars[1], int(scalars[2]), scalars[3]
    y = np.empty(size)
    base = np.empty(size)
    w = np.empty(size)
    residual = np.empty(size)
    model = np.empty((count, size))
    trial_model = np.empty((count, size))
    slope = np.empty((2, size))
    matrix = np.empty((count, count))
    right = np.empty(count)
    columns = np.empty((count, 2))
    c = np.zeros(count)
    trial_c = np.zeros(count)
    n = np.empty(3)
    trial = np.empty(3)
    best = np.empty(3)
    tangent = np.empty((2, 3))
    used = 0
    for f in range(size):
        y[f] = values[p, f]
        base[f] = weights[p, f]
        w[f] = base[f]
        used += 1 if base[f] > 0 else 0
    for i in range(3):
        n[i] = start[p, i]
        best[i] = n[i]
    if used == 0:  # without measurements there is no spread of residuals either
        normals[p] = start[p]
        strengths[p] = 0
        statistics[p, 0], statistics[p, 1], statistics[p, 2] = 0, 0, np.inf
        return
    basis(n, light, diffuse_form, roughness, model)
    loss = non_negative_least_squares(y, w, model, matrix, right, c)
    _tangents(n, tangent)
    for turn in range(16):
        radius = ring * (1 + turn // 8)
        angle = 2 * np.pi * (turn + 0.5 * (turn // 8)) / 8
        _perturbed(n, tangent, radius * np.cos(angle), radius * np.sin(angle), trial)
        basis(trial, light, diffuse_form, roughness, model)
        trial_c[:] = c
        trial_loss = non_negative_least_squares(y, w, model, matrix, right, trial_c)
        if trial_loss < loss:
            loss = trial_loss
            best[:] = trial
    n[:] = best
    spread = least
    variance = 1.0
    for stage in range(2):
        squared = 1e30  # scale² of the Cauchy weights: least squares at first
        if stage == 1:
            basis(n, light, diffuse_form, roughness, model)
            _residuals(y, model, c, residual)
            ordered = np.sort(np.abs(residual) * np.sqrt(base))
            spread = max(ordered[size - used + used // 2] / GAUSSIAN_MEDIAN_DEVIATION, least)
            squared = (cauchy * spread) ** 2
        damping = 1e-3
        loss = 1e30
        for _ in range(iterations):
            basis(n, light, diffuse_form, roughness, model)
            _residuals(y, model, c, residual)
            for f in range(size):
                w[f] = base[f] / (1 + residual[f] * residual[f] * base[f] / squared)
            non_negative_least_squares(y, w, model, matrix, right, c)
            _residuals(y, model, c, residual)
            loss = _cauchy_loss(residual, base, squared)
            _tangents(n, tangent)
            for t in range(2):
                _perturbed(n, tangent, DIFFERENCE_STEP * (1 - t), DIFFERENCE_STEP * t, trial)
                basis(trial, light, diffuse_form, roughness, trial_model)
                for f in range(size):
                    total = 0.0
                    for k in range(count):
                        total += c[k] * (trial_model[k, f] - model[k, f])
                    slope[t, f] = total / DIFFERENCE_STEP
            # Strengths that are zero stay so; the others follow the normal, so their columns are projected out.
            for k in range(count):
                for t in range(2):
                    total = 0.0
                    for f in range(size):
                        total += w[f] * model[k, f] * slope[t, f]
                    columns[k, t] = total if c[k] > 0 else 0.0
                for j in range(count):
                    if c[k] <= 0 or c[j] <= 0:
                        matrix[k, j] = 1.0 if k == j else 0.0
                matrix[k, k] *= 1 + 1e-9
            pixel_solve_kernels.cholesky(matrix)
            pixel_solve_kernels.forward_substitution(matrix, columns)
            a = 0.0
            b = 0.0
            d = 0.0
            g0 = 0.0
            g1 = 0.0
            for f in range(size):
                a += w[f] * slope[0, f] * slope[0, f]
                b += w[f] * slope[0, f] * slope[1, f]
                d += w[f] * slope[1, f] * slope[1, f]
                g0 += w[f] * slope[0, f] * residual[f]
                g1 += w[f] * slope[1, f] * residual[f]
            for k in range(count):
                a -= columns[k, 0] * columns[k, 0]
                b -= columns[k, 0] * columns[k, 1]
                d -= columns[k, 1] * columns[k, 1]
            a = max(a, 1e-9)
            d = max(d, 1e-9)
            variance = (a + d) / max(a * d - b * b, 1e-6 * a * d)
            accepted = False
            length = 0.0
            for _ in range(6):
                aa = a * (1 + damping)
                dd = d * (1 + damping)
                determinant = max(aa * dd - b * b, 1e-12 * aa * dd)
                first = (dd * g0 - b * g1) / determinant
                second = (aa * g1 - b * g0) / determinant
                length = np.sqrt(first * first + second * second)
                if length > 0.3:
                    first *= 0.3 / length
                    second *= 0.3 / length
                _perturbed(n, tangent, first, second, trial)
                basis(trial, light, diffuse_form, roughness, trial_model)
                trial_c[:] = c
                non_negative_least_squares(y, w, trial_model, matrix, right, trial_c)
                _residuals(y, trial_model, trial_c, residual)
                trial_loss = _cauchy_loss(residual, base, squared)
                if trial_loss < loss:
                    accepted = True
                    loss = trial_loss
                    n[:] = trial
                    c[:] = trial_c
                    damping = max(damping * 0.2, 1e-4)
                    break
                damping = max(damping * 8, 0.05)
            if not accepted or length < 2e-4:
                break
    for i in range(3):
        normals[p, i] = n[i]
    for k in range(count):
        strengths[p, k] = c[k]
    statistics[p, 0] = loss
    statistics[p, 1] = spread
    statistics[p, 2] = variance * spread * spread * used / max(used - count - 2, 1)


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float64[:,::1], float64[::1], float64[::1], float64[::1],"
    " float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def fit(
    values: Float32Array,  # (N, F), of about unit height
    weights: Float32Array,  # (N, F) weights of the measurements; 0: not used
    light: FloatArray,  # (6, F)
    diffuse_form: FloatArray,  # (2,) κ and ω
    roughness: FloatArray,  # (K − 1,)
    scalars: FloatArray,  # Cauchy scale in units of the residuals' spread, least spread, iterations, ring in rad
    start: Float32Array,  # (N, 3) normals
    normals: Float32Array,  # (N, 3) out
    strengths: Float32Array,  # (N, K) out: strengths
    statistics: Float32Array,  # (N, 3) out: loss, spread of residuals, variance in rad² over both tangential directions
) -> None:
    """Fits all pixels in parallel: least squares from the best of a ring of starts, then Cauchy-weighted IRLS."""
    for p in numba.prange(values.shape[0]):
        _fit_pixel(values, weights, light, diffuse_form, roughness, scalars, start, normals, strengths, statistics, p)


@numba.njit(
    "void(float64[:,::1], float64[:,::1], float64[::1], float64[::1], float32[:,:,::1])",
    cache=True,
    error_model="numpy",
)
def basis_of_normals(
    normals: FloatArray, light: FloatArray, diffuse_form: FloatArray, roughness: FloatArray, out: Float32Array
) -> None:
    """Evaluates `basis` at normals (N, 3), into (N, K, F)."""
    basis_values = np.empty((out.shape[1], out.shape[2]))
    for p in range(len(normals)):
        basis(normals[p], light, diffuse_form, roughness, basis_values)
        out[p] = basis_values


KERNELS = (
    basis,
    non_negative_least_squares,
    _residuals,
    _cauchy_loss,
    _tangents,
    _perturbed,
    _fit_pixel,
    fit,
    basis_of_normals,
)
