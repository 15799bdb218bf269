"""Conversion of RGB images to one brightness per pixel, in one pass over the stack.

A fused kernel, because the speed is limited by memory: the stack is read twice and no intermediate of its size is made.
"""

import numba
import numpy as np

from acquisition.models.base import Float32Array

BLOCK = 4096
"""Pixels of one block, whose intermediates stay in the processor's cache."""

CLIPPED_VALUE = 1e9
"""Brightness that marks a clipped measurement, in units of white; far above any real one."""


@numba.njit(
    [
        f"void({stored}[:,:,::1], float32[:,::1], float32, float32[::1], float32[::1], boolean, float32[:,::1],"
        " float32[:,::1])"
        for stored in ("uint16", "float32")  # eight-bit values are widened when they are read
    ],
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def mix(
    stored: np.ndarray,  # (F, N, 3) stored values
    gain: Float32Array,  # (F, 3) brightness per stored value
    clipped_from: float,  # stored value
    luma: Float32Array,  # (3,) fixed weights
    channel_weights: Float32Array,  # (3,) 0–1, of the channels
    fixed: bool,  # mix by the fixed weights, and leave clipped measurements as they are
    out: Float32Array,  # (F, N) brightness; CLIPPED where any channel is clipped
    colour: Float32Array,  # (N, 3) out: brightness of each channel over the luma of all
) -> None:
    """Weighted sum of the channels, by fixed luma weights or by the pixel's own mean colour.

    The pixel's own weights are scaled so that a surface of its mean colour has the same luma.
    """
    count, pixels = stored.shape[0], stored.shape[1]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        start, end = block * BLOCK, min(block * BLOCK + BLOCK, pixels)
        weight = np.zeros((3, end - start), np.float32)
        for f in range(count):
            for c in range(3):
                scale = gain[f, c] / np.float32(count)
                for p in range(end - start):
                    weight[c, p] += scale * np.float32(stored[f, start + p, c])
        for p in range(end - start):
            r, g, b = weight[0, p] + np.float32(1e-9), weight[1, p] + np.float32(1e-9), weight[2, p] + np.float32(1e-9)
            light = r * luma[0] + g * luma[1] + b * luma[2]
            colour[start + p, 0], colour[start + p, 1], colour[start + p, 2] = r / light, g / light, b / light
            if fixed:
                weight[0, p], weight[1, p], weight[2, p] = luma[0], luma[1], luma[2]
            else:
                one, two, three = r * channel_weights[0], g * channel_weights[1], b * channel_weights[2]
                share = light / (one * r + two * g + three * b)
                weight[0, p], weight[1, p], weight[2, p] = one * share, two * share, three * share
        for f in range(count):
            for p in range(end - start):
                r = np.float32(stored[f, start + p, 0])
                g = np.float32(stored[f, start + p, 1])
                b = np.float32(stored[f, start + p, 2])
                value = weight[0, p] * gain[f, 0] * r + weight[1, p] * gain[f, 1] * g + weight[2, p] * gain[f, 2] * b
                clipped = not fixed and max(r, g, b) >= clipped_from
                out[f, start + p] = np.float32(CLIPPED_VALUE) if clipped else value


KERNELS = (mix,)
