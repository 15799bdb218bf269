/**
 * Pictures of the API, fetched with the key and shown from memory.
 *
 * At most two are under way at the same time, and all are abandoned when a stop is pressed: a browser has six
 * connections to a host, and a stop must never wait for pictures.
 */
import { send } from "./requests";

const AT_ONCE = 2;
/** Number of pictures kept in memory, by address. */
const KEPT = 60;

let running = 0;
const waiting: (() => void)[] = [];
/** Abort controllers of the requests under way, one each: a signal for the page's lifetime would keep their data. */
const underWay = new Set<AbortController>();
const kept = new Map<string, Promise<string>>();

/** The picture at an address as a `blob:` address, from memory if it was shown before. */
export function picture(address: string): Promise<string> {
  const known = kept.get(address);
  if (known) return known;
  const made = fetchBlob(address).then((blob) => URL.createObjectURL(blob));
  kept.set(address, made);
  made.catch(() => kept.delete(address));
  while (kept.size > KEPT) forget(kept.keys().next().value!);
  return made;
}

/** A file's bytes, queued with the pictures. */
export async function fetchBlob(address: string, timeoutMs = 60_000): Promise<Blob> {
  if (running >= AT_ONCE) await new Promise<void>((resolve) => waiting.push(resolve));
  running += 1;
  const abort = new AbortController();
  underWay.add(abort);
  try {
    return await (await send("GET", address, { signal: abort.signal, timeoutMs })).blob();
  } finally {
    underWay.delete(abort);
    running -= 1;
    waiting.shift()?.();
  }
}

/** Ends all requests for pictures that are under way. */
export function abandonPictures(): void {
  for (const abort of underWay) abort.abort();
}

function forget(address: string): void {
  void kept.get(address)?.then((url) => URL.revokeObjectURL(url));
  kept.delete(address);
}
