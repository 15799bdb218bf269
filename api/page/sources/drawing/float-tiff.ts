/** Reads a result's float maps: uncompressed little-endian TIFF of 32-bit floats, one or three values per pixel. */

export interface FloatMap {
  width: number;
  height: number;
  /** Values per pixel. */
  channels: number;
  values: Float32Array;
}

const WIDTH = 256;
const HEIGHT = 257;
const COMPRESSION = 259;
const STRIP_OFFSETS = 273;
const CHANNELS = 277;
const STRIP_BYTES = 279;
const SAMPLE_FORMAT = 339;
const FLOAT = 3;
/** Bytes of a value of each TIFF type in the tags that are read here (short, long). */
const TYPE_BYTES: Record<number, number> = { 3: 2, 4: 4 };

/** Reads a float map. Throws RangeError for a file of another kind. */
export function readFloatTiff(buffer: ArrayBuffer): FloatMap {
  const view = new DataView(buffer);
  if (view.getUint16(0) !== 0x4949 || view.getUint16(2, true) !== 42) throw new RangeError("not a little-endian TIFF");
  const tags = readTags(view, view.getUint32(4, true));
  const one = (tag: number, otherwise: number): number => tags.get(tag)?.[0] ?? otherwise;
  if (one(COMPRESSION, 1) !== 1 || one(SAMPLE_FORMAT, 1) !== FLOAT)
    throw new RangeError("not an uncompressed float map");
  const [width, height, channels] = [one(WIDTH, 0), one(HEIGHT, 0), one(CHANNELS, 1)];
  const values = new Float32Array(width * height * channels);
  const bytes = new Uint8Array(values.buffer);
  const counts = tags.get(STRIP_BYTES) ?? [];
  let filled = 0;
  (tags.get(STRIP_OFFSETS) ?? []).forEach((offset, strip) => {
    bytes.set(new Uint8Array(buffer, offset, counts[strip]), filled);
    filled += counts[strip]!;
  });
  if (filled !== bytes.length) throw new RangeError("a TIFF of another size than it says");
  return { width, height, channels, values };
}

function readTags(view: DataView, start: number): Map<number, number[]> {
  const tags = new Map<number, number[]>();
  for (let entry = 0; entry < view.getUint16(start, true); entry += 1) {
    const at = start + 2 + 12 * entry;
    const size = TYPE_BYTES[view.getUint16(at + 2, true)];
    if (!size) continue;
    const count = view.getUint32(at + 4, true);
    const from = size * count <= 4 ? at + 8 : view.getUint32(at + 8, true);
    const read = (index: number): number =>
      size === 2 ? view.getUint16(from + 2 * index, true) : view.getUint32(from + 4 * index, true);
    tags.set(
      view.getUint16(at, true),
      Array.from({ length: count }, (_, index) => read(index)),
    );
  }
  return tags;
}
