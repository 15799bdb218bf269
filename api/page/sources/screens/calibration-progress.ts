/** A calibration session: next view, the camera's image, accuracy found and requested, residuals, next steps. */
import { html, nothing } from "lit";
import { customElement, property } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { ofSession, Reading } from "../connection/reading";
import { all, get, Refusal } from "../connection/requests";
import type { Estimate, Pass, PassSummary, PlannedViews, Session } from "../connection/schemas";
import { scene } from "../connection/scene";
import { domeOf, type Dome } from "../drawing/dome-geometry";
import "../drawing/dome-plot";
import { changedNames } from "../parts/calibration-checks";
import "../parts/calibration-sets";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { plannedView } from "../parts/planned-view";
import { readingState } from "../parts/reading-state";
import "../parts/target-preview";
import "../parts/tool-statement";
import { duration, milliseconds, number, t, tOr } from "../words/language";
import { imageName, stageName } from "../words/names";

const STAGES = ["plan", "waypoints", "capture", "estimate"] as const;
/** The figure with which each ordered accuracy is compared. */
const FOUND: Record<string, string> = { target_px: "projection_sigma_px", target_mm: "position_sigma_mm" };
/** Files of an estimate without residuals. */
const OTHER_FILES = new Set(["basis.json", "summary.json", "calibration.json", "corners.json", "manifest.json"]);
/** Facts of an image that are not shown as figures. */
const HIDDEN = new Set(["image", "sha256", "why_not", "lamp"]);

type Residual = Record<string, string | number | null>;

interface Found {
  planned: PlannedViews | null;
  /** The pass under way, of a kind whose views are lights on the dome. */
  pass: Pass | null;
  dome: Dome | null;
  estimate: Estimate | null;
  residuals: Residual[];
}

@customElement("calibration-progress")
export class CalibrationProgress extends PageElement {
  @property({ attribute: false }) session!: Session;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading<Found>(
    this,
    () => this.read(),
    ofSession(this, /^(shot|shots|plan|waypoints|estimate)\./),
  );

  private async read(): Promise<Found> {
    const address = `/v1/sessions/${this.session.id}`;
    const before = this.reading.found;
    const passes = await all<PassSummary>(`${address}/passes`);
    const last = passes.filter((one) => one.lights > 0).at(-1);
    const planned = last ? await viewsOf(`${address}/passes/${last.number}/views`) : null;
    const pass = last && !planned ? await get<Pass>(`${address}/passes/${last.number}`) : null;
    const dome = pass ? domeOf(await scene()) : null;
    const estimate = (await all<Estimate>(`${address}/estimates`)).at(-1) ?? null;
    const known = before && before.estimate?.created === estimate?.created ? before.residuals : null;
    const residuals = known ?? (estimate ? await residualsOf(estimate) : []);
    return { planned, pass, dome, estimate, residuals };
  }

  override render() {
    const { session } = this;
    const { found } = this.reading;
    const running = session.state === "running";
    return html`<ol class="stages" aria-label=${t("progress.stages")}>
        ${STAGES.map(
          (stage) =>
            html`<li aria-current=${running && session.stage === stage ? "step" : nothing}>
              ${stageName(session, stage)}
            </li>`,
        )}
      </ol>
      ${readingState(this.reading)} ${found ? this.figures(found) : nothing}
      ${session.ended ? (found ? this.next(found) : nothing) : this.eyes(found)} ${found ? this.table(found) : nothing}`;
  }

  private figures({ estimate }: Found) {
    const { session } = this;
    const summary = (estimate?.summary ?? {}) as Record<string, unknown>;
    const recipe = session.recipe as unknown as Record<string, unknown>;
    const wished = Object.keys(FOUND).filter((name) => recipe[name] != null);
    const compared = wished.map((name) => FOUND[name]);
    const rest = Object.entries(summary).filter(
      ([name, value]) => typeof value === "number" && !compared.includes(name) && !["images", "used"].includes(name),
    );
    const images = `${String(summary["used"] ?? 0)} / ${String(recipe["max_images"] ?? "")}`;
    return html`<dl class="figures" id="estimate">
        ${figure(t("estimate.used"), images)}
        ${session.ended ? nothing : figure(t("progress.left"), duration(session.seconds_left))}
        ${wished.map((name) => {
          const found = summary[FOUND[name]!] as number | undefined;
          const words = t("estimate.wished", { found: number(found), wished: number(Number(recipe[name])) });
          return figure(tOr(`estimate.${FOUND[name]}`, name), words, FOUND[name]);
        })}
        ${rest.map(([name, value]) => figure(tOr(`estimate.${name}`, name), number(value as number, 3), name))}
      </dl>
      ${estimate && !estimate.summary.estimated ? html`<p class="notice">${estimate.summary.why_not}</p>` : nothing}`;
  }

  private eyes(found: Found | null) {
    const { planned, pass, dome } = found ?? {};
    const next = planned?.views.find((one) => one.number === planned.next);
    return html`<div class="split">
      <section class="card" aria-labelledby="next-view">
        <h2 id="next-view">${t(pass ? "plan.lights" : "view.next")}</h2>
        ${planned && next ? plannedView(planned, next) : pass ? this.lights(pass, dome ?? null) : html`<p>${t("view.none")}</p>`}
      </section>
      <section class="card" aria-labelledby="seen">
        <h2 id="seen">${t("view.seen")}</h2>
        <target-preview .board=${live.rig?.tool === "board"}></target-preview>
      </section>
    </div>`;
  }

  private lights({ plan, shots }: Pass, dome: Dome | null) {
    const taken = new Set(shots.map(({ shot }) => shot.light_number));
    return html`<dome-plot
      .dome=${dome}
      .lights=${plan.lights.map(({ position }, index) => ({
        position,
        label: String(index + 1),
        kind: taken.has(index) ? "taken" : "planned",
      }))}
    ></dome-plot>`;
  }

  /** What to do after the end of the session. */
  private next({ estimate }: Found) {
    const summary = estimate?.summary;
    if (!summary?.estimated) return html`<p class="notice warning">${t("next.nothing")}</p>`;
    if (summary.passed != null) return this.verdict(summary);
    const wished = Object.keys(FOUND).some((name) => (this.session.recipe as unknown as Values)[name] != null);
    const advice = (summary.advice ?? []).filter((one) => !one.includes("/v1/"));
    return html`<section class="card" aria-labelledby="next">
      <h2 id="next">${t("next.title")}</h2>
      <p class=${wished && !summary.reached ? "notice warning" : "notice good"} id="reached">
        ${t(wished ? (summary.reached ? "next.reached" : "next.missed") : "next.found")}
      </p>
      ${advice.map((one) => html`<p>${one}</p>`)}
      <h3>1. ${t("next.use")}</h3>
      <calibration-sets .only=${this.session.id}></calibration-sets>
      <h3>2. ${t("next.lamp")}</h3>
      <tool-statement .needed=${"lamp"}></tool-statement>
      <h3>3. ${t("next.then")}</h3>
      <p>${t("next.then.why")}</p>
    </section>`;
  }

  /** The result of a check, which makes no calibration that could be used. */
  private verdict({ passed, changed, advice }: Estimate["summary"]) {
    return html`<section class="card" aria-labelledby="next">
      <h2 id="next">${t("next.title")}</h2>
      <p class=${passed ? "notice good" : "notice danger"} id="verdict">
        ${t(passed ? "check.passed" : "check.failed")}${changed?.length ? html`. ${changedNames(changed)}` : nothing}
      </p>
      ${(advice ?? []).map((one) => html`<p>${one}</p>`)}
    </section>`;
  }

  private table({ residuals }: Found) {
    const columns = [...new Set(residuals.flatMap((one) => Object.keys(one)))].filter((name) => !HIDDEN.has(name));
    if (residuals.length === 0) return nothing;
    return html`<h2>${t("residuals.title")}</h2>
      <p>${t("residuals.why")}</p>
      ${listTable(
        t("residuals.title"),
        [t("residuals.image"), ...columns.map((name) => tOr(`residual.${name}`, name))],
        residuals.map(
          (one) =>
            html`<tr data-view=${one["image"]}>
              <td>${this.imageOf(String(one["image"]))}</td>
              ${columns.map((name) => html`<td>${cell(one[name]) ?? one["why_not"] ?? t("residuals.unseen")}</td>`)}
            </tr>`,
        ),
      )}`;
  }

  /** Names an image by its pass and number. */
  private imageOf(path: string): string {
    const [, pass, image] = /^passes\/(\d+)\/shots\/(\d+)/.exec(path) ?? [];
    return image ? `${t("progress.pass", { number: pass! })}, ${imageName(this.session, Number(image))}` : path;
  }
}

type Values = Record<string, unknown>;

/** Content of an estimate's files about single images, or about the images of one exposure time. */
interface Residuals {
  views?: Residual[];
  images?: Residual[];
  exposures?: (Residual & { exposure_s: number })[];
}

function figure(name: string, value: string, id = "") {
  return html`<div>
    <dt>${name}</dt>
    <dd data-figure=${id || nothing}>${value}</dd>
  </div>`;
}

function cell(value: string | number | null | undefined): string | null {
  if (typeof value !== "number") return value ?? null;
  return Number.isInteger(value) ? String(value) : number(value, 3);
}

/** The views of a pass; null for a kind without a board. */
async function viewsOf(address: string): Promise<PlannedViews | null> {
  try {
    return await get<PlannedViews>(address);
  } catch (error) {
    if (error instanceof Refusal && error.problem.status === 404) return null;
    throw error;
  }
}

/** Each image's residual in an estimate, from the first of its files that has one; the camera's file is read last. */
async function residualsOf({ artefacts }: Estimate): Promise<Residual[]> {
  const files = artefacts.filter(({ name }) => name.endsWith(".json") && !OTHER_FILES.has(name));
  files.sort((one, other) => Number(one.name === "camera.json") - Number(other.name === "camera.json"));
  for (const { href } of files) {
    const { views, images, exposures } = await get<Residuals>(href);
    const times = exposures?.map(({ exposure_s, ...rest }) => ({
      image: milliseconds(exposure_s),
      ...rest,
    }));
    const found = views ?? times ?? images;
    if (found) return found;
  }
  return [];
}
