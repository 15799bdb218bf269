/** A new session: presets, the recipe's form, and what its first pass would do. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { create } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { post, Refusal, UNLIMITED } from "../connection/requests";
import { randomName } from "../connection/random-name";
import { scene } from "../connection/scene";
import type { DryRun } from "../connection/schemas";
import { domeOf, type Dome } from "../drawing/dome-geometry";
import "../drawing/dome-plot";
import { PageElement } from "../parts/element";
import { forecastCurve } from "../parts/forecast-curve";
import { reasonShown, whyNoMove } from "../parts/move-reason";
import { saidOf } from "../parts/problem";
import { PRESETS } from "../recipe/presets";
import "../recipe/recipe-form";
import type { Values } from "../recipe/recipe-form";
import { recipeFields, type Field } from "../recipe/recipe-schema";
import { degrees, duration, t } from "../words/language";
import { remedyOf } from "../words/problems";

/** Pause after the last change before the dry run, ms. */
const SETTLED_MS = 500;

/** The number of images of a recipe; null if a target accuracy or the person's own lights determine it. */
function lightsOf({ method, pilot_lights: pilot, planned_lights: planned, target_sigma_deg: target }: Values) {
  return method === "user" || target ? null : Number(pilot) + Number(planned);
}

@customElement("start-screen")
export class StartScreen extends PageElement {
  @state() private fields: Field[] = [];
  @state() private values: Values = {};
  @state() private preset = 1;
  @state() private dryRun: DryRun | null = null;
  @state() private dryRunFailed: unknown = null;
  @state() private computing = false;
  @state() private failed: unknown = null;
  @state() private starting = false;
  @state() private dome: Dome | null = null;
  protected readonly watching = new LiveController(this);
  private timer = 0;
  private abort = new AbortController();

  override connectedCallback(): void {
    super.connectedCallback();
    void this.load();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    clearTimeout(this.timer);
    this.abort.abort();
  }

  private async load(): Promise<void> {
    try {
      this.fields = await recipeFields();
      this.dome = domeOf(await scene());
      this.choosePreset(this.preset);
    } catch (error) {
      this.failed = error;
      setTimeout(() => this.isConnected && this.dome === null && void this.load(), 2_000);
    }
  }

  override render() {
    return html`<h1>${t("start.title")}</h1>
      ${this.obstacles()}
      <div class="split">
        <form class="card" id="recipe" @submit=${(event: Event) => void this.submit(event)}>
          <fieldset class="presets">
            <legend>${t("start.presets")}</legend>
            ${PRESETS.map(
              (preset, index) =>
                html`<label class="preset"
                  ><input
                    type="radio"
                    name="preset"
                    .checked=${index === this.preset}
                    @change=${() => this.choosePreset(index)}
                  /><b>${t(preset.name)}</b><small>${t(preset.explanation)}</small></label
                >`,
            )}
          </fieldset>
          <recipe-form
            .fields=${this.fields}
            .values=${this.values}
            .errors=${this.fieldErrors()}
            @values=${(event: CustomEvent<Values>) => this.change(event.detail)}
          ></recipe-form>
        </form>
        <div class="beside-form">
          ${this.go()}
          <section class="card" aria-labelledby="dry-run-title" aria-busy=${String(this.computing)}>
            <h2 id="dry-run-title">${t("start.dry_run")}</h2>
            ${this.outlook()}
          </section>
        </div>
      </div>`;
  }

  private go() {
    if (!live.mayOperate) return html`<p class="notice">${t("viewer.only_looks")}</p>`;
    const why = whyNoMove();
    const unnamed = !this.values["label"];
    return html`${this.failed ? saidOf(this.failed, this.dome ? "action" : "reading") : nothing}
      <div class="actions">
        <button
          class="primary large"
          form="recipe"
          value="start"
          id="start"
          ?disabled=${this.starting || why !== null || !live.rig?.may_start}
        >
          ${t("start.start")}
        </button>
        <button form="recipe" value="create" ?disabled=${this.starting}>${t("start.create")}</button>
        <button form="recipe" value="queue" ?disabled=${this.starting || unnamed}>${t("start.queue")}</button>
        ${reasonShown(why)} ${reasonShown(unnamed ? t("start.queue_label") : null)}
      </div>`;
  }

  private obstacles() {
    const rig = live.rig;
    if (!rig || rig.may_start) return nothing;
    return html`<div class="notice warning">
      <b>${t("start.not_now")}</b>
      <ul>
        ${rig.reasons.map((reason) => html`<li>${reason.detail}. ${remedyOf(reason.code, reason.remedy)}</li>`)}
      </ul>
    </div>`;
  }

  private outlook() {
    if (this.computing)
      return html`<p role="status">${t("start.computing")}</p>
        <progress aria-label=${t("start.computing")}></progress>`;
    if (this.dryRunFailed) return saidOf(this.dryRunFailed, "choice");
    if (!this.dryRun) return html`<p>${t("start.no_dry_run")}</p>`;
    const { plan, route, seconds, forecast } = this.dryRun;
    const images = lightsOf(this.values) ?? plan.lights.length;
    const reached = forecast.points.find((point) => point.lights === images);
    const order = route.light_numbers.map((light) => plan.lights[light]!);
    return html`<dl class="figures">
        <div>
          <dt>${t("start.lights")}</dt>
          <dd id="dry-run-lights">${plan.lights.length}</dd>
        </div>
        <div>
          <dt>${t("start.moves")}</dt>
          <dd>${duration(route.seconds)}</dd>
        </div>
        <div>
          <dt>${t("start.duration")}</dt>
          <dd id="dry-run-seconds">${duration(seconds)}</dd>
        </div>
        ${
          reached
            ? html`<div>
                <dt>${t("start.sigma", { images })}</dt>
                <dd id="dry-run-sigma">${degrees(reached.sigma_deg)}</dd>
              </div>`
            : nothing
        }
      </dl>
      ${this.prospect(this.dryRun)}
      <h3>${t("start.way")}</h3>
      <dome-plot
        .dome=${this.dome}
        route
        .lights=${order.map((light, index) => ({
          position: light.position,
          label: String(index + 1),
          kind: plan.method === "pilot" ? "pilot" : "planned",
        }))}
      ></dome-plot>
      <p class="caption">${t("start.dome")}</p>
      ${plan.notes?.map((note) => html`<p class="notice">${note}</p>`)}`;
  }

  /** The accuracy to expect against the number of images, for an assumed object. */
  private prospect({ plan, forecast }: DryRun) {
    const piloted = plan.method === "pilot";
    return html`<h3>${t("start.forecast")}</h3>
      ${forecast.points.length > 1 ? forecastCurve(forecast.points) : nothing}
      <p class="caption" id="forecast-assumption">
        ${t("start.forecast_assumption")} ${piloted ? t("start.forecast_later") : nothing}
      </p>`;
  }

  private fieldErrors(): Record<string, string> {
    const error = this.failed ?? this.dryRunFailed;
    if (!(error instanceof Refusal)) return {};
    return Object.fromEntries((error.problem.errors ?? []).map(({ field, message }) => [field, message]));
  }

  private choosePreset(index: number): void {
    this.preset = index;
    const usual = Object.fromEntries(this.fields.map((field) => [field.name, field.otherwise ?? null]));
    const kept = { label: this.values["label"] ?? "", notes: this.values["notes"] ?? "" };
    this.change({ ...usual, ...PRESETS[index]!.values, ...kept });
  }

  private change(values: Values): void {
    const planning = ({ label: _label, notes: _notes, ...rest }: Values): string => JSON.stringify(rest);
    const same = planning(values) === planning(this.values);
    this.values = values;
    this.failed = null;
    if (same && (this.dryRun || this.computing)) return;
    this.abort.abort();
    this.dryRun = this.dryRunFailed = null; // they belong to other values
    this.plan();
  }

  /** Computes what is missing once the rig has become free. */
  override updated(): void {
    if (this.dome && this.mayTry && !this.dryRun && !this.dryRunFailed && !this.computing) this.plan();
  }

  private plan(): void {
    this.computing = this.mayTry;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.tryOut(), SETTLED_MS);
  }

  private get mayTry(): boolean {
    return live.mayOperate && live.rig?.holder == null;
  }

  private async tryOut(): Promise<void> {
    this.abort.abort();
    const abort = (this.abort = new AbortController());
    this.computing = this.mayTry;
    if (!this.computing) return;
    this.dryRunFailed = null;
    try {
      const options = { signal: abort.signal, timeoutMs: UNLIMITED };
      const dryRun = await post<DryRun>("/v1/dry-runs", this.recipe(), options);
      if (abort.signal.aborted) return;
      this.dryRun = dryRun;
    } catch (error) {
      if (abort.signal.aborted) return;
      this.dryRun = null;
      this.dryRunFailed = error;
    }
    if (this.abort === abort) this.computing = false;
  }

  /** The values without the empty ones, for which the service's defaults apply. */
  private recipe(): Values {
    return Object.fromEntries(Object.entries(this.values).filter(([, value]) => value !== null));
  }

  private async submit(event: Event): Promise<void> {
    event.preventDefault();
    const wish = ((event as SubmitEvent).submitter as HTMLButtonElement | null)?.value ?? "start";
    this.starting = true;
    this.failed = null;
    try {
      if (wish === "queue") {
        const headers = { "Idempotency-Key": randomName() };
        await post("/v1/queue/entries", { object_name: this.values["label"], recipe: this.recipe() }, { headers });
        location.hash = "#/queue";
        return;
      }
      await create(this.recipe(), wish === "start");
    } catch (error) {
      this.failed = error;
    }
    this.starting = false;
  }
}
