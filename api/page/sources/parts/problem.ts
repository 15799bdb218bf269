/** What went wrong and what to do, from a problem object or from a connection that failed. */
import { html, type TemplateResult } from "lit";
import { Refusal, Unreachable } from "../connection/requests";
import { t } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

export function saidOf(error: unknown): TemplateResult {
  if (error instanceof Refusal) {
    const { code, title, detail, remedy } = error.problem;
    return html`<div class="notice warning" role="alert">
      <b>${problemTitle(code, title)}</b>
      <p>${detail}${detail.endsWith(".") ? "" : "."} ${remedyOf(code, remedy)}</p>
    </div>`;
  }
  const words = error instanceof Unreachable ? t("problem.unreachable") : String(error);
  return html`<div class="notice warning" role="alert">${words}</div>`;
}
