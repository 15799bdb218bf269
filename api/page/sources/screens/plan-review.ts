/** A session's plans: lights on the dome with their gains, and the forecast. A review moves and accepts lights. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { attemptMove } from "../connection/actions";
import { JournalController, live, LiveController } from "../connection/live";
import { PlanForecasting, type LightForecast } from "../connection/plan-forecast";
import { Reading, RETRY_MS } from "../connection/reading";
import { Refusal, all, get, post, send } from "../connection/requests";
import { scene } from "../connection/scene";
import type { Pass, PassSummary, Session, Vector3 } from "../connection/schemas";
import { domeOf, positionAt, type Dome } from "../drawing/dome-geometry";
import "../drawing/dome-plot";
import { PageElement } from "../parts/element";
import { forecastCurve } from "../parts/forecast-curve";
import { lightTable } from "../parts/light-table";
import { reasonShown, whyNoMove } from "../parts/move-reason";
import { saidOf } from "../parts/problem";
import { readingState } from "../parts/reading-state";
import { degrees, percent, t, type Word } from "../words/language";

@customElement("plan-review")
export class PlanReview extends PageElement {
  @property({ attribute: false }) session!: Session;
  @state() private dome: Dome | null = null;
  @state() private candidates: Vector3[] = [];
  @state() private passes: PassSummary[] = [];
  @state() private pass: Pass | null = null;
  @state() private lights: Vector3[] = [];
  @state() private changed = false;
  @state() private selected = -1;
  @state() private saving = false;
  @state() private forecast: LightForecast | null = null;
  @state() private forecastFailed: unknown = null;
  @state() private sigmaPicture = "";
  private forecasting: PlanForecasting | null = null;
  private timer = 0;
  private wanted: number | undefined;
  private readFor = "";
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading(this, () => this.read(), { once: true });
  protected readonly hearing = new JournalController(this, ({ type, session_id }) => {
    if (session_id === this.session.id && type === "plan.ready" && !this.saving) void this.load();
  });

  override willUpdate(): void {
    if (this.readFor === this.session.id) return;
    const another = this.readFor !== "";
    this.readFor = this.session.id;
    if (!another) return; // it is being read already
    this.pass = null;
    this.wanted = undefined;
    this.reading.restart();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    clearTimeout(this.timer);
    URL.revokeObjectURL(this.sigmaPicture);
    this.sigmaPicture = "";
  }

  private async load(wanted?: number): Promise<void> {
    this.wanted = wanted;
    await this.reading.load();
  }

  private async read(): Promise<true> {
    const { id } = this.session;
    const known = await scene();
    const passes = await all<PassSummary>(`/v1/sessions/${id}/passes`);
    const last = this.wanted ?? passes.filter((pass) => pass.lights > 0).at(-1)?.number;
    const pass = last === undefined ? null : await get<Pass>(`/v1/sessions/${id}/passes/${last}`);
    if (id !== this.session.id) return true; // another session has been opened meanwhile
    this.dome = domeOf(known);
    this.candidates = (known.lights ?? [])
      .filter((light) => !light.refusal)
      .map((light) => light.position as unknown as Vector3);
    this.passes = passes;
    if (pass) this.show(pass);
    return true;
  }

  private show(pass: Pass, forecast = true): void {
    this.pass = pass;
    this.lights = pass.plan.lights.map((light) => [...light.position] as unknown as Vector3);
    this.changed = false;
    this.selected = -1;
    this.forecast = this.forecastFailed = null;
    this.forecasting = new PlanForecasting(
      `/v1/sessions/${this.session.id}/passes/${pass.number}/plan/forecast`,
      (forecast) => {
        this.forecast = forecast;
        this.forecastFailed = null;
      },
      (error) => this.askAgain(error),
    );
    if (forecast && this.editable(pass)) this.ask();
  }

  private editable(pass: Pass): boolean {
    return this.reviewing && pass.plan.method !== "pilot";
  }

  /** Requests the forecast of the present lights, and σ as a picture once they are at rest. */
  private ask(settled = true): void {
    this.forecasting?.ask(this.lights);
    if (settled) void this.showPicture();
  }

  private async showPicture(): Promise<void> {
    const lights = this.lights;
    try {
      const blob = await this.forecasting!.picture(lights);
      if (lights !== this.lights || !this.isConnected) return;
      URL.revokeObjectURL(this.sigmaPicture);
      this.sigmaPicture = URL.createObjectURL(blob);
    } catch (error) {
      if (lights !== this.lights) return;
      URL.revokeObjectURL(this.sigmaPicture);
      this.sigmaPicture = ""; // of other lights
      this.askAgain(error);
    }
  }

  /** Shows a failure, and repeats the request after a while if it may succeed then. */
  private askAgain(error: unknown): void {
    this.forecastFailed = error;
    clearTimeout(this.timer);
    if (error instanceof Refusal && error.problem.code !== "rig.busy" && ![429, 503].includes(error.problem.status))
      return;
    const again = () => this.isConnected && this.pass && this.editable(this.pass) && this.ask();
    this.timer = window.setTimeout(again, RETRY_MS);
  }

  private get reviewing(): boolean {
    return this.session.state === "paused" && this.session.reason?.code === "plan.to_review" && live.mayOperate;
  }

  override render() {
    const { pass } = this;
    const read = this.reading.found !== null;
    if (!pass || !this.dome)
      return html`${readingState(this.reading)} ${read ? html`<p role="status">${t("plan.none")}</p>` : nothing}`;
    const { plan } = pass;
    const editable = this.editable(pass);
    return html`${readingState(this.reading)}
      <div class="split">
        <section class="card" aria-label=${t("plan.lights")}>
          ${this.choice(pass.number)} ${editable ? html`<p>${t("plan.drag")}</p>` : nothing}
          <dome-plot
            .dome=${this.dome}
            .candidates=${this.candidates}
            .editable=${editable}
            .selected=${this.selected}
            .lights=${this.lights.map((position, index) => ({
              position,
              label: String(index + 1),
              kind: this.refusal(index) ? "refused" : plan.method === "pilot" ? "pilot" : "planned",
              note: this.gain(index),
            }))}
            @light-chosen=${(event: CustomEvent<number>) => (this.selected = event.detail)}
            @light-moved=${this.move}
            @light-dropped=${() => this.ask()}
          ></dome-plot>
          ${editable ? this.editing() : nothing}
        </section>
        <section class="card" aria-label=${t("plan.forecast")}>${this.figures(pass)}</section>
      </div>
      ${lightTable({
        positions: this.lights,
        dome: this.dome,
        selected: this.selected,
        select: (index) => (this.selected = index),
        gain: (index) => this.gain(index),
        pictures: this.changed ? [] : pass.gain_pictures,
        reasons: this.changed ? [] : plan.reasons,
      })}`;
  }

  private choice(shown: number) {
    return html`<div class="tabs small" role="group" aria-label=${t("plan.passes")}>
      ${this.passes.map(
        ({ number: one, method }) =>
          html`<button type="button" aria-pressed=${String(one === shown)} @click=${() => void this.load(one)}>
            ${method === "pilot" ? t("progress.pilot") : t("progress.pass", { number: one })}
          </button>`,
      )}
    </div>`;
  }

  private editing() {
    return html`<div class="actions">
        <button type="button" @click=${this.add}>${t("plan.add")}</button>
        <button type="button" ?disabled=${this.selected < 0 || this.lights.length < 2} @click=${this.omit}>
          ${t("plan.remove")}
        </button>
        <button type="button" ?disabled=${!this.changed} @click=${() => this.show(this.pass!)}>
          ${t("plan.undo")}
        </button>
      </div>
      <div class="actions">
        <button
          type="button"
          class="primary"
          id="accept-plan"
          ?disabled=${this.saving || whyNoMove() !== null || this.lights.some((_, index) => this.refusal(index) !== null)}
          @click=${() => void this.accept()}
        >
          ${t(this.changed ? "plan.accept_changed" : "plan.accept")}
        </button>
        ${reasonShown(whyNoMove())}
      </div>`;
  }

  private figures(pass: Pass) {
    const { plan } = pass;
    const { forecast } = this;
    const sigma = this.changed ? forecast?.sigma_deg : (forecast?.sigma_deg ?? plan.predicted_sigma_deg);
    const facts: [string, string, string][] = [];
    if (forecast?.sigma_before_deg != null)
      facts.push(["sigma-before", t("plan.before"), degrees(forecast.sigma_before_deg)]);
    if (sigma != null) facts.push(["sigma-forecast", t("plan.predicted"), degrees(sigma)]);
    if (plan.efficiency != null && !this.changed)
      facts.push(["efficiency", t("plan.efficiency"), percent(plan.efficiency)]);
    if (plan.two_rings_efficiency != null && !this.changed)
      facts.push(["two-rings", t("plan.two_rings"), percent(plan.two_rings_efficiency)]);
    return html`<h2>${t("plan.forecast")}</h2>
      ${this.forecastFailed ? saidOf(this.forecastFailed, "reading") : nothing}
      ${
        facts.length
          ? html`<dl class="figures">
              ${facts.map(
                ([id, name, value]) =>
                  html`<div>
                    <dt>${name}</dt>
                    <dd id=${id}>${value}</dd>
                  </div>`,
              )}
            </dl>`
          : html`<p>${t("plan.no_forecast")}</p>`
      }
      ${this.sigmaPicture && this.editable(pass) ? this.sigmaMap() : nothing}
      ${plan.forecast?.length && !this.changed ? forecastCurve(plan.forecast) : nothing}
      ${plan.certificate_note ? html`<p>${plan.certificate_note}</p>` : nothing}
      ${plan.notes?.map((note) => html`<p class="notice">${note}</p>`)}`;
  }

  private sigmaMap() {
    return html`<figure>
      <img id="sigma-picture" class="sigma" src=${this.sigmaPicture} alt=${t("plan.sigma_picture")} />
      <figcaption>
        ${t("plan.sigma_picture")}: ${t("plan.sigma_scale", { sigma: degrees(this.forecast?.brightest_sigma_deg) })}
      </figcaption>
    </figure>`;
  }

  private refusal(index: number): string | null {
    const refusal = this.forecast?.lights[index]?.refusal;
    return refusal ? t(`refusal.${refusal.reason}` as Word) : null;
  }

  /** A light's gain, or why the arm cannot serve it, by the forecast, else by the plan. */
  private gain(index: number): string {
    const refusal = this.refusal(index);
    if (refusal) return refusal;
    const planned = this.changed ? undefined : this.pass?.plan.gains?.[index];
    const share = this.forecast?.lights[index]?.gain ?? planned;
    return share == null ? "–" : t("plan.gain_value", { share: percent(share, 1) });
  }

  private readonly move = (event: CustomEvent<{ index: number; position: Vector3 }>): void => {
    this.lights = this.lights.map((light, index) => (index === event.detail.index ? event.detail.position : light));
    this.changed = true;
    this.ask(false);
  };

  private readonly add = (): void => {
    this.lights = [...this.lights, positionAt({ slant: 0.6, azimuth: this.lights.length }, this.dome!)];
    this.selected = this.lights.length - 1;
    this.changed = true;
    this.ask();
  };

  private readonly omit = (): void => {
    this.lights = this.lights.filter((_, index) => index !== this.selected);
    this.selected = -1;
    this.changed = true;
    this.ask();
  };

  private async accept(): Promise<void> {
    this.saving = true;
    const { id } = this.session;
    await attemptMove(t("plan.accept"), async (options) => {
      if (this.changed) {
        const address = `/v1/sessions/${id}/passes/${this.pass!.number}/plan`;
        const answer = await send("PUT", address, { ...options(), body: { lights: this.lights } });
        this.show((await answer.json()) as Pass, false);
      }
      await post(`/v1/sessions/${id}/actions`, { action: "resume" }, options());
    });
    live.refreshSession(id);
    live.refreshRig();
    this.saving = false;
  }
}
