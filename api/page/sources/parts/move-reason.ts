/** Why nothing that moves the arm is possible now, in words beside the disabled controls; null: it is possible. */
import { html, nothing } from "lit";
import { live } from "../connection/live";
import { t } from "../words/language";

/** Reason for everything that moves. */
export function whyNoMove(): string | null {
  if (live.stale || !live.joints) return t("move.stale");
  if (live.sending.length > 0) return t("bar.sending", { name: live.sending.at(-1)! });
  return live.rig?.faults.length ? t("move.stopped") : null;
}

/** Reason for moves outside of sessions. */
export function whyNoMoveByHand(): string | null {
  return whyNoMove() ?? (live.rig?.holder == null ? null : t("move.busy"));
}

export function reasonShown(why: string | null) {
  return why === null ? nothing : html`<p class="why" role="status">${why}</p>`;
}
