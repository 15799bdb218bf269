/** The calibration in use: whether it is valid, and how old it is. */
import { html } from "lit";
import { customElement } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { PageElement } from "../parts/element";
import { number, t, when } from "../words/language";

const DAY_MS = 86_400_000;

@customElement("calibration-screen")
export class CalibrationScreen extends PageElement {
  protected readonly watching = new LiveController(this);

  override render() {
    const calibration = live.rig?.calibration;
    if (!calibration) return html`<p role="status">${t("loading")}</p>`;
    const days = (time: string): string => number((Date.now() - Date.parse(time)) / DAY_MS, 0);
    const left = number((Date.parse(calibration.valid_until) - Date.now()) / DAY_MS, 0);
    return html`<h1>${t("screen.calibration")}</h1>
      <p class=${calibration.valid ? "notice good" : "notice danger"}>
        ${calibration.valid ? t("calibration.valid", { days: left }) : t("calibration.invalid")}
      </p>
      <dl class="figures">
        <div>
          <dt>${t("calibration.made")}</dt>
          <dd class="words">${when(calibration.made_at)}</dd>
        </div>
        <div>
          <dt>${t("calibration.age")}</dt>
          <dd>${t("calibration.days", { days: days(calibration.made_at) })}</dd>
        </div>
        <div>
          <dt>${t("calibration.until")}</dt>
          <dd class="words">${when(calibration.valid_until)}</dd>
        </div>
      </dl>
      <p>${t("calibration.how")}</p>`;
  }
}
