/** The forecast σ of a plan against the number of images, logarithmic, as a pilot's σ is ten times the final one. */
import { html, type TemplateResult } from "lit";
import type { Plan } from "../connection/schemas";
import "../drawing/curve-plot";
import { t } from "../words/language";

export function forecastCurve(forecast: NonNullable<Plan["forecast"]>): TemplateResult {
  return html`<curve-plot
    points
    logarithmic
    .x=${forecast.map((point) => point.lights)}
    .y=${forecast.map((point) => point.sigma_deg)}
    .xLabel=${t("plan.images")}
    .yLabel=${t("plan.sigma_axis")}
  ></curve-plot>`;
}
