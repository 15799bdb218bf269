/** The viridis colour scale, and pictures of maps with one value per pixel. */
import type { FloatMap } from "./float-tiff";

/** Coefficients of viridis as polynomials of sixth degree, by Matt Zucker (shadertoy WlfXRN, CC0). */
const VIRIDIS: readonly (readonly [number, number, number])[] = [
  [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
  [0.1050930431085774, 1.404613529898575, 1.384590162594685],
  [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
  [-4.634230498983486, -5.799100973351585, -19.33244095627987],
  [6.228269936347081, 14.17993336680509, 56.69055260068105],
  [4.776384997670288, -13.74514537774601, -65.35303263337234],
  [-5.435455855934631, 4.645852612178535, 26.3124352495832],
];

/** Colour of a value from 0 to 1, 8 bits. */
export function viridis(value: number): [number, number, number] {
  const x = Math.min(1, Math.max(0, value));
  const sum = (channel: 0 | 1 | 2): number => VIRIDIS.reduceRight((total, row) => total * x + row[channel], 0);
  return [sum(0), sum(1), sum(2)].map((part) => Math.round(Math.min(1, Math.max(0, part)) * 255)) as [
    number,
    number,
    number,
  ];
}

export const COLOURS = Array.from({ length: 256 }, (_, level) => viridis(level / 255));

/** Maximum number of values from which quantiles are taken. */
const SAMPLES = 100_000;

/** Quantiles of the finite values where `inside` is set; of a large map from a sample. */
export function quantiles(map: FloatMap, inside: Uint8Array, shares: readonly number[]): number[] {
  const step = Math.max(1, Math.floor(map.values.length / SAMPLES));
  const sample: number[] = [];
  for (let index = 0; index < map.values.length; index += step)
    if (inside[index] && Number.isFinite(map.values[index])) sample.push(map.values[index]!);
  const kept = Float32Array.from(sample).sort();
  return shares.map((share) => kept[Math.min(kept.length - 1, Math.floor(share * kept.length))] ?? 0);
}

/** Colours a map from `low` to `high`, transparent outside. */
export function coloured(map: FloatMap, inside: Uint8Array, low: number, high: number): ImageData {
  const colours = COLOURS.map(packed);
  return painted(map, inside, (value) => colours[levelOf((value - low) / (high - low || 1), 255)]!);
}

/** Shows a map as grey with gamma 2.2, white at `high`, transparent outside. */
export function grey(map: FloatMap, inside: Uint8Array, high: number): ImageData {
  const greys = Array.from({ length: GREY_LEVELS + 1 }, (_, level) => {
    const shade = Math.round(255 * (level / GREY_LEVELS) ** (1 / 2.2));
    return packed([shade, shade, shade]);
  });
  return painted(map, inside, (value) => greys[levelOf(value / high, GREY_LEVELS)]!);
}

/** Number of steps of linear grey: enough for 8 bits after the gamma. */
const GREY_LEVELS = 4095;

function levelOf(share: number, most: number): number {
  return Math.round(Math.min(1, Math.max(0, share)) * most) || 0;
}

/** Packs an opaque colour into the 32 bits of a pixel; canvases are little-endian wherever browsers run. */
function packed([red, green, blue]: readonly [number, number, number]): number {
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

function painted(map: FloatMap, inside: Uint8Array, colourOf: (value: number) => number): ImageData {
  const picture = new ImageData(map.width, map.height);
  const pixels = new Uint32Array(picture.data.buffer);
  for (let index = 0; index < pixels.length; index += 1)
    if (inside[index]) pixels[index] = colourOf(map.values[index]!);
  return picture;
}
