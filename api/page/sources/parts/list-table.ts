/** The frame of a table that lists things: it scrolls in itself where the window is narrow, by keyboard too. */
import { html, type TemplateResult } from "lit";

/** `columns` are the headings, those that are shown to this caller. */
export function listTable(label: string, columns: readonly string[], rows: readonly TemplateResult[]): TemplateResult {
  return html`<div class="scrolled" tabindex="0" role="group" aria-label=${label}>
    <table class="list">
      <thead>
        <tr>
          ${columns.map((column) => html`<th scope="col">${column}</th>`)}
        </tr>
      </thead>
      <tbody>
        ${rows}
      </tbody>
    </table>
  </div>`;
}
