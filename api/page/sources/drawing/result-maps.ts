/** A result's maps as they are downloaded, each once: normals as a picture, the others as floats. */
import { fetchBlob } from "../connection/pictures";
import type { Result } from "../connection/schemas";
import { coloured, grey, quantiles } from "./colour-scale";
import { readFloatTiff, type FloatMap } from "./float-tiff";

export const MAP_NAMES = ["normals", "albedo", "sigma_deg", "depth", "residual"] as const;
export type MapName = (typeof MAP_NAMES)[number];

/** A map as a picture, with the ends of its scale. */
export interface MapPicture {
  image: ImageData;
  low: number | null;
  high: number | null;
}

export class ResultMaps {
  private readonly floats = new Map<string, Promise<FloatMap>>();
  private readonly pictures = new Map<string, Promise<ImageData>>();

  constructor(readonly result: Result) {}

  /** Pixels with a normal: 1, else 0. */
  async inside(): Promise<Uint8Array> {
    const mask = await this.bitmap("mask.png");
    return Uint8Array.from({ length: mask.width * mask.height }, (_, index) => (mask.data[4 * index]! > 127 ? 1 : 0));
  }

  /** A float map by name. */
  values(name: Exclude<MapName, "normals"> | "normals"): Promise<FloatMap> {
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

  /** The normals as colours, 8 bits. */
  normals(): Promise<ImageData> {
    return this.bitmap("normals.png");
  }

  /** A map as a picture: normals in their colours, albedo grey, the others in the colour scale. */
  async picture(name: MapName, range?: readonly [number, number]): Promise<MapPicture> {
    const inside = await this.inside();
    if (name === "normals") {
      const image = new ImageData(new Uint8ClampedArray((await this.normals()).data), (await this.normals()).width);
      inside.forEach((solved, index) => (image.data[4 * index + 3] = solved ? 255 : 0));
      return { image, low: null, high: null };
    }
    const map = await this.values(name);
    const [low, high] = range ?? this.range(name, map, inside);
    return { image: name === "albedo" ? grey(map, inside, high) : coloured(map, inside, low, high), low, high };
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

async function pixelsOf(blob: Blob): Promise<ImageData> {
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const ink = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d", { willReadFrequently: true })!;
  ink.drawImage(bitmap, 0, 0);
  const pixels = ink.getImageData(0, 0, bitmap.width, bitmap.height);
  bitmap.close();
  return pixels;
}

/** Angles between two results' normals in degrees, where both have one. */
export async function normalDifference(one: ResultMaps, other: ResultMaps): Promise<FloatMap> {
  const [a, b, inside, beside] = await Promise.all([
    one.values("normals"),
    other.values("normals"),
    one.inside(),
    other.inside(),
  ]);
  if (a.width !== b.width || a.height !== b.height) throw new RangeError("results of different sizes");
  const values = new Float32Array(a.width * a.height).fill(NaN);
  for (let index = 0; index < values.length; index += 1) {
    if (!inside[index] || !beside[index]) continue;
    let dot = 0;
    for (let axis = 0; axis < 3; axis += 1) dot += a.values[3 * index + axis]! * b.values[3 * index + axis]!;
    values[index] = (Math.acos(Math.min(1, Math.max(-1, dot))) * 180) / Math.PI;
  }
  return { width: a.width, height: a.height, channels: 1, values };
}
