/** Words for missing content: it is being read, or it could not be read and is tried again. */
import { html, nothing } from "lit";
import type { Reading } from "../connection/reading";
import { t } from "../words/language";
import { saidOf } from "./problem";

export function readingState(reading: Reading<unknown>) {
  if (reading.failed !== null) return saidOf(reading.failed, "reading");
  return reading.found === null ? html`<p role="status">${t("loading")}</p>` : nothing;
}
