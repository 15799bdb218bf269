/** What a live image is called: the camera's image now, or an old one, which must not pass for it. */
import { live } from "../connection/live";
import { clock, t } from "../words/language";

/** An image that came this long ago is old, ms. */
const OLD_MS = 2_000;

/** `shownAt`: when it came, ms since 1970; 0: there is none yet. */
export function isOld(shownAt: number): boolean {
  return shownAt > 0 && Date.now() - shownAt > OLD_MS;
}

export function imageCaption(shownAt: number): string {
  if (isOld(shownAt)) return t("preview.old", { time: clock(shownAt) });
  return t(live.rig?.holder ? "preview.last_frame" : "preview.live");
}
