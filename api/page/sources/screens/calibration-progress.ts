/** A calibration session: the next view as a picture, what the camera sees, accuracy found and wished, residuals, what next. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { JournalController, live, LiveController } from "../connection/live";
import { all, get, Refusal } from "../connection/requests";
import type { Estimate, Pass, PassSummary, PlannedViews, Session } from "../connection/schemas";
import { scene } from "../connection/scene";
import { domeOf, type Dome } from "../drawing/dome-geometry";
import "../drawing/dome-plot";
import "../parts/calibration-sets";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { plannedView } from "../parts/planned-view";
import "../parts/target-preview";
import "../parts/tool-statement";
import { duration, number, t, tOr, type Word } from "../words/language";

const STAGES = ["plan", "waypoints", "capture", "estimate"] as const;
/** What an accuracy on order is compared with. */
const FOUND: Record<string, string> = { target_px: "projection_sigma_px", target_mm: "position_sigma_mm" };
/** Files of an estimate that hold no residuals. */
const OTHER_FILES = new Set(["summary.json", "calibration.json", "corners.json", "manifest.json"]);
/** Facts of an image that are no figure to be read. */
const HIDDEN = new Set(["image", "sha256", "why_not"]);

type Residual = Record<string, string | number | null>;

@customElement("calibration-progress")
export class CalibrationProgress extends PageElement {
  @property({ attribute: false }) session!: Session;
  @state() private planned: PlannedViews | null = null;
  /** The pass that is under way, of a kind whose views are lights on the dome. */
  @state() private pass: Pass | null = null;
  @state() private dome: Dome | null = null;
  @state() private estimate: Estimate | null = null;
  @state() private residuals: Residual[] = [];
  private read = "";
  private reading = false;
  private again = false;
  protected readonly watching = new LiveController(this);
  protected readonly hearing = new JournalController(this, ({ type, session_id }) => {
    if (session_id === this.session.id && /^(shot|shots|plan|waypoints|estimate)\./.test(type)) void this.load();
  });

  override willUpdate(): void {
    if (this.read === this.session.id) return;
    this.read = this.session.id;
    this.planned = this.estimate = this.pass = null;
    this.residuals = [];
    void this.load();
  }

  private async load(): Promise<void> {
    if (this.reading) {
      this.again = true;
      return;
    }
    this.reading = true;
    const address = `/v1/sessions/${this.session.id}`;
    try {
      const passes = await all<PassSummary>(`${address}/passes`);
      const pass = passes.filter((one) => one.lights > 0).at(-1);
      this.planned = pass ? await viewsOf(`${address}/passes/${pass.number}/views`) : null;
      this.pass = pass && !this.planned ? await get<Pass>(`${address}/passes/${pass.number}`) : null;
      if (this.pass) this.dome = domeOf(await scene());
      const estimate = (await all<Estimate>(`${address}/estimates`)).at(-1) ?? null;
      if (estimate && estimate.created !== this.estimate?.created) this.residuals = await residualsOf(estimate);
      this.estimate = estimate;
    } catch {
      setTimeout(() => this.isConnected && void this.load(), 2_000); // the bar tells the age of the connection
    }
    this.reading = false;
    if (!this.again) return;
    this.again = false;
    void this.load();
  }

  override render() {
    const { session } = this;
    const running = session.state === "running";
    return html`<ol class="stages" aria-label=${t("progress.stages")}>
        ${STAGES.map(
          (stage) =>
            html`<li aria-current=${running && session.stage === stage ? "step" : nothing}>
              ${t(stage === "plan" ? "stage.views" : (`stage.${stage}` as Word))}
            </li>`,
        )}
      </ol>
      ${this.figures()} ${session.ended ? this.next() : this.eyes()} ${this.table()}`;
  }

  private figures() {
    const { session, estimate } = this;
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

  private eyes() {
    const { planned } = this;
    const next = planned?.views.find((one) => one.number === planned.next);
    return html`<div class="split">
      <section class="card" aria-labelledby="next-view">
        <h2 id="next-view">${t("view.next")}</h2>
        ${planned && next ? plannedView(planned, next) : this.pass ? this.lights(this.pass) : html`<p>${t("view.none")}</p>`}
      </section>
      <section class="card" aria-labelledby="seen">
        <h2 id="seen">${t("view.seen")}</h2>
        <target-preview .board=${live.rig?.tool === "board"}></target-preview>
      </section>
    </div>`;
  }

  private lights({ plan, shots }: Pass) {
    const taken = new Set(shots.map(({ shot }) => shot.light_number));
    return html`<dome-plot
      .dome=${this.dome}
      .lights=${plan.lights.map(({ position }, index) => ({
        position,
        label: String(index + 1),
        kind: taken.has(index) ? "taken" : "planned",
      }))}
    ></dome-plot>`;
  }

  /** What to do now that it has ended. */
  private next() {
    const summary = this.estimate?.summary;
    if (!summary?.estimated) return html`<p class="notice warning">${t("next.nothing")}</p>`;
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

  private table() {
    const columns = [...new Set(this.residuals.flatMap((one) => Object.keys(one)))].filter((name) => !HIDDEN.has(name));
    if (this.residuals.length === 0) return nothing;
    return html`<h2>${t("residuals.title")}</h2>
      <p>${t("residuals.why")}</p>
      ${listTable(
        t("residuals.title"),
        [t("residuals.image"), ...columns.map((name) => tOr(`residual.${name}`, name))],
        this.residuals.map(
          (one) =>
            html`<tr data-view=${one["image"]}>
              <td>${imageName(String(one["image"]))}</td>
              ${columns.map((name) => html`<td>${cell(one[name]) ?? one["why_not"] ?? t("residuals.unseen")}</td>`)}
            </tr>`,
        ),
      )}`;
  }
}

type Values = Record<string, unknown>;

function figure(name: string, value: string, id = "") {
  return html`<div>
    <dt>${name}</dt>
    <dd data-figure=${id || nothing}>${value}</dd>
  </div>`;
}

/** An image's pass and number in words. */
function imageName(path: string): string {
  const [, pass, image] = /^passes\/(\d+)\/shots\/(\d+)/.exec(path) ?? [];
  return image ? `${t("progress.pass", { number: pass! })}, ${t("view.name", { number: Number(image) + 1 })}` : path;
}

function cell(value: string | number | null | undefined): string | null {
  if (typeof value !== "number") return value ?? null;
  return Number.isInteger(value) ? String(value) : number(value, 3);
}

/** The views of a pass; none for a kind without a board. */
async function viewsOf(address: string): Promise<PlannedViews | null> {
  try {
    return await get<PlannedViews>(address);
  } catch (error) {
    if (error instanceof Refusal && error.problem.status === 404) return null;
    throw error;
  }
}

/** Each image's part in an estimate, from whichever of its files tells it. */
async function residualsOf({ artefacts }: Estimate): Promise<Residual[]> {
  const files = artefacts.filter(({ name }) => name.endsWith(".json") && !OTHER_FILES.has(name));
  const file = files.find(({ name }) => name !== "camera.json") ?? files[0];
  if (!file) return [];
  const values = await get<{ views?: Residual[]; images?: Residual[] }>(file.href);
  return values.views ?? values.images ?? [];
}
