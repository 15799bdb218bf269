/** The frame of a table of items. In a narrow window it scrolls by itself, by keyboard too. */
import { html, type TemplateResult } from "lit";

/** `columns` are the headings that are shown to this caller. */
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
