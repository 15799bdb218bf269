/** Title of a live image: the camera's present image, or an old one, which must not be mistaken for it. */
import { live } from "../connection/live";
import { clock, t } from "../words/language";

/** Age above which an image is old, ms. */
const OLD_MS = 2_000;

/** `shownAt` is the image's arrival, ms since 1970; 0: there is none yet. */
export function isOld(shownAt: number): boolean {
  return shownAt > 0 && Date.now() - shownAt > OLD_MS;
}

export function imageCaption(shownAt: number): string {
  if (isOld(shownAt)) return t("preview.old", { time: clock(shownAt) });
  return t(live.rig?.holder ? "preview.last_frame" : "preview.live");
}
