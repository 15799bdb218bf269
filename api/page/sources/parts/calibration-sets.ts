/** All calibrations with their figures, and the choice of the one in use, which asks for confirmation. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { attempt } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { Reading } from "../connection/reading";
import { all, send } from "../connection/requests";
import type { CalibrationSet } from "../connection/schemas";
import { number, t, tOr, when } from "../words/language";
import { PageElement } from "./element";
import { listTable } from "./list-table";
import { readingState } from "./reading-state";

@customElement("calibration-sets")
export class CalibrationSets extends PageElement {
  /** Identifier of the only one to show; null: all. */
  @property({ attribute: false }) only: string | null = null;
  @state() private asked: string | null = null;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading(this, () => all<CalibrationSet>("/v1/rig/calibrations"), {
    again: ({ type }) => type.startsWith("calibration."),
  });

  override render() {
    const shown = this.reading.found?.filter((one) => this.only === null || one.id === this.only);
    if (!shown) return readingState(this.reading);
    const columns = [t("sets.what"), t("calibration.made"), t("sets.images"), t("estimate.position_sigma_mm")];
    columns.push(t("estimate.projection_sigma_px"), t("sets.use"));
    return html`${readingState(this.reading)}
    ${listTable(
      t("sets.title"),
      columns,
      shown.map((one) => this.row(one)),
    )}
    ${this.asked ? this.question(this.asked) : nothing}`;
  }

  private row(one: CalibrationSet) {
    const name = one.kind === null ? t("sets.cell_file") : tOr(`kind.${one.kind}`, one.kind);
    return html`<tr data-calibration=${one.id} class=${one.active ? "selected" : ""}>
      <td>${one.kind === null ? name : html`<a href=${`#/sessions/${one.id}`}>${name}</a>`}</td>
      <td>${when(one.made_at)}</td>
      <td>${one.summary?.used ?? "–"}</td>
      <td>${number(one.summary?.position_sigma_mm)}</td>
      <td>${number(one.summary?.projection_sigma_px)}</td>
      <td>
        ${
          one.active
            ? html`<b>${t("sets.in_use")}</b>`
            : one.fits
              ? html`<span class="warns">${one.fits}</span>`
              : live.mayOperate
                ? html`<button
                    type="button"
                    ?disabled=${live.rig?.holder != null}
                    @click=${() => (this.asked = one.id)}
                  >
                    ${t("sets.activate")}
                  </button>`
                : nothing
        }
      </td>
    </tr>`;
  }

  private question(id: string) {
    return html`<div class="question" role="group" aria-label=${t("sets.activate")}>
      <p>${t("sets.ask")}</p>
      <button type="button" class="primary" id="activate" @click=${() => void this.activate(id)}>
        ${t("sets.activate")}
      </button>
      <button type="button" @click=${() => (this.asked = null)}>${t("cancel")}</button>
    </div>`;
  }

  private async activate(id: string): Promise<void> {
    this.asked = null;
    await attempt(t("sets.activate"), () => send("PUT", "/v1/rig/calibrations/active", { body: { id } }));
    live.refreshRig();
    void this.reading.load();
  }
}
