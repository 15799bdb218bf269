/** The last checks of the calibration in use: target, age and result. */
import { html, nothing } from "lit";
import type { Rig } from "../connection/schemas";
import { duration, t, tOr } from "../words/language";

const TARGETS = ["board", "plane"] as const;
/** Age at which another check is suggested, s. */
const DUE_S = 86_400;

export function calibrationChecks({ calibration: { check } }: Rig) {
  return html`<ul class="checks" id="calibration-checks">
    ${TARGETS.map((target) => {
      const made = check.checks?.[target];
      const age = (check.ages_h?.[target] ?? 0) * 3_600;
      const good = made?.passed === true && age <= DUE_S;
      const found = made ? t(made.passed ? "check.passed" : "check.failed") : t("check.never");
      return html`<li class=${good ? "good" : "bad"} data-check=${target}>
        <i aria-hidden="true">${good ? "✓" : made?.passed === false ? "✕" : "○"}</i> ${t(`check.${target}`)}:
        ${
          made
            ? html`<a href=${`#/sessions/${made.session}`}>${found}</a>, ${t("check.ago", { time: duration(age) })}
                ${made.changed.length ? html`<small>${changedNames(made.changed)}</small>` : nothing}`
            : found
        }
        ${made && age > DUE_S ? html`<small>${t("check.due")}</small>` : nothing}
      </li>`;
    })}
  </ul>`;
}

/** Names the changed parts of a calibration in words. */
export function changedNames(parts: readonly string[]): string {
  return t("check.changed", { parts: parts.map((part) => tOr(`changed.${part}`, part)).join(", ") });
}
