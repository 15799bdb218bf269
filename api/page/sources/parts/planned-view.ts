/** A planned view as a picture: the board's place in the camera's image, with its first corner marked. */
import { html, svg, type TemplateResult } from "lit";
import type { PlannedViews } from "../connection/schemas";
import { number, t } from "../words/language";

type View = NonNullable<PlannedViews["views"][number]["view"]>;

export function plannedView(
  { width_px, height_px }: PlannedViews,
  planned: PlannedViews["views"][number],
): TemplateResult {
  const name = t("view.name", { number: planned.number + 1 });
  if (!planned.view) return html`<p>${name}: ${planned.reason}</p>`;
  const { outline_px: outline, corners_px: corners } = planned.view;
  const radius = width_px / 150;
  const where = whereOf(planned.view);
  return html`<figure>
    <svg class="view" viewBox=${`0 0 ${width_px} ${height_px}`} role="img" aria-label=${`${name}: ${where}`}>
      ${svg`<polygon points=${outline.map((one) => one.join(",")).join(" ")}></polygon>
        ${corners.map(([x, y]) => svg`<circle cx=${x} cy=${y} r=${radius}></circle>`)}
        <circle class="origin" cx=${outline[0]![0]} cy=${outline[0]![1]} r=${3 * radius}></circle>`}
    </svg>
    <figcaption><b>${name}</b>: ${where}. ${reasonOf(planned.reason)}</figcaption>
  </figure>`;
}

export function whereOf({ distance_m, tilt_deg }: View): string {
  return t("view.where", { distance: number(1e3 * distance_m, 0), tilt: number(tilt_deg, 0) });
}

/** The reason for a view: the uncertainty left after it, in the page's language. */
function reasonOf(reason: string): string {
  const [, value, unit] = /^leaves ([\d.e+-]+) (\S+)$/.exec(reason) ?? [];
  return value ? t("view.leaves", { value: number(Number(value), 2), unit: unit! }) : reason;
}
