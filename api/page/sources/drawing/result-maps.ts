/**
 * A result's maps, each downloaded once: normals as a picture, the others as floats.
 *
 * Drawn maps are reduced to the resolution of a screen, and loops over pixels are short, because a page that computes
 * does not react to a press on STOP. Values and profiles are read pixel by pixel from the full maps.
 */
import { fetchBlob } from "../connection/pictures";
import { number } from "../words/language";
import { coloured, grey, quantiles } from "./colour-scale";
import { readFloatTiff, type FloatMap } from "./float-tiff";

export const MAP_NAMES = ["normals", "albedo", "sigma_deg", "depth", "residual"] as const;
export type MapName = (typeof MAP_NAMES)[number];

/** Digits, unit and factor of a map's values. */
const UNITS: Record<MapName, readonly [number, string, number]> = {
  normals: [3, "", 1],
  albedo: [3, "", 1],
  sigma_deg: [2, "°", 1],
  depth: [2, " mm", 1e3],
  residual: [2, "", 1],
};

/** Formats a value of a map. */
export function mapValue(name: MapName, value: number): string {
  const [digits, unit, factor] = UNITS[name];
  return `${number(value * factor, digits)}${unit}`;
}

/** Thrown for two results whose images differ in size, given as "width × height" each. */
export class SizesDiffer extends Error {
  constructor(
    readonly one: string,
    readonly other: string,
  ) {
    super(`${one}, ${other}`);
  }
}

/** Maximum number of pixels of a drawn map; it takes some tens of milliseconds to compute. */
const DRAWN_PIXELS = 1_100_000;

/** Location of a result's maps: below the address `self`. */
export interface MapSource {
  links: Record<string, string>;
}

/** A map as a picture, with the ends of its scale. Values beyond an end have its colour. */
export interface MapPicture {
  name: MapName;
  image: ImageData;
  low: number | null;
  high: number | null;
}

export class ResultMaps {
  private readonly floats = new Map<string, Promise<FloatMap>>();
  private readonly pictures = new Map<string, Promise<ImageData>>();
  private mask: Promise<FloatMap> | null = null;

  constructor(readonly result: MapSource) {}

  /** A float map by name, with every pixel. */
  values(name: MapName): Promise<FloatMap> {
    let made = this.floats.get(name);
    if (!made) {
      made = this.file(`${name}.tiff`)
        .then((blob) => blob.arrayBuffer())
        .then(readFloatTiff);
      made.catch(() => this.floats.delete(name));
      this.floats.set(name, made);
    }
    return made;
  }

  /** A float map as it is drawn: a large one is subsampled. */
  async drawn(name: MapName): Promise<FloatMap> {
    return reduced(await this.values(name));
  }

  /** Pixels of a drawn map with a normal: 1, else 0. */
  async inside(): Promise<Uint8Array> {
    this.mask ??= this.bitmap("mask.png").then((mask) => {
      const values = new Float32Array(mask.width * mask.height);
      for (let index = 0; index < values.length; index += 1) values[index] = mask.data[4 * index]! > 127 ? 1 : 0;
      return { width: mask.width, height: mask.height, channels: 1, values };
    });
    return Uint8Array.from(reduced(await this.mask).values);
  }

  /** The normals as they are drawn, in 8-bit colours. */
  async normals(): Promise<ImageData> {
    const { width, height, data } = await this.bitmap("normals.png");
    const step = stepOf(width, height);
    if (step === 1) return new ImageData(new Uint8ClampedArray(data), width);
    const small = new ImageData(Math.ceil(width / step), Math.ceil(height / step));
    const from = new Uint32Array(data.buffer);
    const to = new Uint32Array(small.data.buffer);
    for (let row = 0; row < small.height; row += 1)
      for (let column = 0; column < small.width; column += 1)
        to[row * small.width + column] = from[row * step * width + column * step]!;
    return small;
  }

  /** A map as a picture: normals in their colours, albedo in grey, the others in the colour scale. */
  async picture(name: MapName, range?: readonly [number, number]): Promise<MapPicture> {
    const inside = await this.inside();
    if (name === "normals") {
      const image = await this.normals();
      for (let index = 0; index < inside.length; index += 1) image.data[4 * index + 3] = inside[index] ? 255 : 0;
      return { name, image, low: null, high: null };
    }
    const map = await this.drawn(name);
    const [low, high] = range ?? this.range(name, map, inside);
    return { name, image: name === "albedo" ? grey(map, inside, high) : coloured(map, inside, low, high), low, high };
  }

  private range(name: MapName, map: FloatMap, inside: Uint8Array): [number, number] {
    const [low, high] = quantiles(map, inside, [0.02, 0.98]) as [number, number];
    if (name === "depth") return [low, high];
    const step = 10 ** Math.floor(Math.log10(Math.max(high, 1e-6))) / 2;
    return [0, Math.ceil(high / step) * step];
  }

  private bitmap(name: string): Promise<ImageData> {
    let made = this.pictures.get(name);
    if (!made) {
      made = this.file(name).then(pixelsOf);
      made.catch(() => this.pictures.delete(name));
      this.pictures.set(name, made);
    }
    return made;
  }

  private file(name: string): Promise<Blob> {
    return fetchBlob(`${this.result.links["self"]}/${name}`);
  }
}

function stepOf(width: number, height: number): number {
  return Math.max(1, Math.ceil(Math.sqrt((width * height) / DRAWN_PIXELS)));
}

/** Subsamples a map that is larger than what is drawn. */
function reduced(map: FloatMap): FloatMap {
  const step = stepOf(map.width, map.height);
  if (step === 1) return map;
  const { channels } = map;
  const [width, height] = [Math.ceil(map.width / step), Math.ceil(map.height / step)];
  const values = new Float32Array(width * height * channels);
  let to = 0;
  for (let row = 0; row < height; row += 1)
    for (let column = 0; column < width; column += 1)
      for (let channel = 0; channel < channels; channel += 1)
        values[to++] = map.values[channels * (row * step * map.width + column * step) + channel]!;
  return { width, height, channels, values };
}

async function pixelsOf(blob: Blob): Promise<ImageData> {
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const ink = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d", { willReadFrequently: true })!;
  ink.drawImage(bitmap, 0, 0);
  const pixels = ink.getImageData(0, 0, bitmap.width, bitmap.height);
  bitmap.close();
  return pixels;
}

/** Angles between two results' normals where both have one, degrees, at the drawn resolution. */
export async function normalDifference(one: ResultMaps, other: ResultMaps): Promise<FloatMap> {
  const [a, b, inside, beside] = await Promise.all([
    one.drawn("normals"),
    other.drawn("normals"),
    one.inside(),
    other.inside(),
  ]);
  if (a.width !== b.width || a.height !== b.height)
    throw new SizesDiffer(`${a.width} × ${a.height}`, `${b.width} × ${b.height}`);
  const values = new Float32Array(a.width * a.height).fill(NaN);
  for (let index = 0; index < values.length; index += 1) {
    if (!inside[index] || !beside[index]) continue;
    let dot = 0;
    for (let axis = 0; axis < 3; axis += 1) dot += a.values[3 * index + axis]! * b.values[3 * index + axis]!;
    values[index] = (Math.acos(Math.min(1, Math.max(-1, dot))) * 180) / Math.PI;
  }
  return { width: a.width, height: a.height, channels: 1, values };
}
