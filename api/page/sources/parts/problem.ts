/** An error and its remedy, from a problem object or a failed connection. */
import { html, type TemplateResult } from "lit";
import { Refusal, Unreachable } from "../connection/requests";
import { t } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

/** What failed: an action, a reading that the page repeats by itself, or one that a person has to choose again. */
const UNREACHED = {
  action: "problem.unreachable",
  reading: "problem.unread",
  choice: "problem.unread_choice",
} as const;

export function saidOf(error: unknown, what: keyof typeof UNREACHED = "action", name = ""): TemplateResult {
  const whose = name ? `${name}: ` : "";
  if (error instanceof Refusal) {
    const { code, title, detail, remedy } = error.problem;
    return html`<div class="notice warning" role="alert">
      <b>${whose}${problemTitle(code, title)}</b>
      <p>${detail}${detail.endsWith(".") ? "" : "."} ${remedyOf(code, remedy)}</p>
    </div>`;
  }
  return html`<div class="notice warning" role="alert">
    ${whose}${error instanceof Unreachable ? t(UNREACHED[what]) : String(error)}
  </div>`;
}
