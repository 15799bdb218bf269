/** What went wrong and what to do, from a problem object or from a connection that failed. */
import { html, type TemplateResult } from "lit";
import { Refusal, Unreachable } from "../connection/requests";
import { t } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

/** `what` failed: an action, which somebody has to ask for again, or a reading, which the page repeats by itself. */
export function saidOf(error: unknown, what: "action" | "reading" = "action", name = ""): TemplateResult {
  const whose = name ? `${name}: ` : "";
  if (error instanceof Refusal) {
    const { code, title, detail, remedy } = error.problem;
    return html`<div class="notice warning" role="alert">
      <b>${whose}${problemTitle(code, title)}</b>
      <p>${detail}${detail.endsWith(".") ? "" : "."} ${remedyOf(code, remedy)}</p>
    </div>`;
  }
  const unreached = t(what === "action" ? "problem.unreachable" : "problem.unread");
  return html`<div class="notice warning" role="alert">
    ${whose}${error instanceof Unreachable ? unreached : String(error)}
  </div>`;
}
