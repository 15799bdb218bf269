/** The lights of a plan as a table: direction, gain, gain map, and the reason for the choice. */
import { html, nothing, type TemplateResult } from "lit";
import { directionOf, type Dome } from "../drawing/dome-geometry";
import { number, t } from "../words/language";
import "./api-picture";
import { listTable } from "./list-table";

export interface LightTable {
  positions: readonly (readonly number[])[];
  dome: Dome;
  selected: number;
  select: (index: number) => void;
  /** The gain of a light in words. */
  gain: (index: number) => string;
  /** Addresses of gain maps, and reasons; empty if a person has moved the lights. */
  pictures: readonly string[];
  reasons: readonly string[];
}

export function lightTable(table: LightTable): TemplateResult {
  const planned = table.reasons.length > 0;
  const columns = [t("plan.light"), t("plan.slant"), t("plan.azimuth"), t("plan.gain")];
  if (planned) columns.push(t("plan.gain_where"), t("plan.reason"));
  return html`<h2>${t("plan.lights")}</h2>
    ${listTable(
      t("plan.lights"),
      columns,
      table.positions.map((position, index) => row(table, position, index, planned)),
    )}`;
}

function row(table: LightTable, position: readonly number[], index: number, planned: boolean) {
  const { slant, azimuth } = directionOf(position, table.dome);
  const picture = table.pictures[index];
  return html`<tr class=${index === table.selected ? "selected" : ""} @click=${() => table.select(index)}>
    <td>${index + 1}</td>
    <td>${number((slant * 180) / Math.PI, 0)}°</td>
    <td>${number((azimuth * 180) / Math.PI, 0)}°</td>
    <td>${table.gain(index)}</td>
    ${
      planned
        ? html`<td>
              ${
                picture
                  ? html`<api-picture
                      class="small"
                      .address=${picture}
                      .alternative=${t("plan.gain_picture", { number: index + 1 })}
                    ></api-picture>`
                  : "–"
              }
            </td>
            <td>${table.reasons[index] ?? ""}</td>`
        : nothing
    }
  </tr>`;
}
