/**
 * Calibration: what to calibrate, what must be on the flange, whether the camera sees it, and the start of a session;
 * below it the existing calibrations. A running session has the same screen as every session.
 *
 * Kinds, their tools and their forms are read from the service, so that a new kind appears without a change.
 */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { create } from "../connection/actions";
import { JournalController, live, LiveController } from "../connection/live";
import { get, Refusal } from "../connection/requests";
import type { CalibrationKind, Page } from "../connection/schemas";
import { calibrationChecks } from "../parts/calibration-checks";
import "../parts/calibration-sets";
import "../parts/calibration-values";
import { PageElement } from "../parts/element";
import { reasonShown, whyNoMove } from "../parts/move-reason";
import { saidOf } from "../parts/problem";
import "../parts/first-views";
import "../parts/target-preview";
import "../parts/tool-statement";
import "../recipe/recipe-form";
import type { Values } from "../recipe/recipe-form";
import { recipeFields, type Field } from "../recipe/recipe-schema";
import { number, t, tOr } from "../words/language";

/** Pause before a failed reading is repeated, ms. */
const RETRY_MS = 2_000;

@customElement("calibration-screen")
export class CalibrationScreen extends PageElement {
  @state() private kinds: CalibrationKind[] = [];
  @state() private chosen: CalibrationKind | null = null;
  @state() private fields: Field[] = [];
  @state() private values: Values = {};
  @state() private failed: unknown = null;
  @state() private starting = false;
  protected readonly watching = new LiveController(this);
  protected readonly hearing = new JournalController(this, ({ type }) => {
    if (type === "calibration.made") void this.load();
  });

  override connectedCallback(): void {
    super.connectedCallback();
    void this.load();
  }

  private async load(): Promise<void> {
    try {
      this.kinds = (await get<Page<CalibrationKind>>("/v1/rig/calibration-kinds")).items;
      this.failed = null;
    } catch (error) {
      this.failed = error;
      setTimeout(() => this.isConnected && void this.load(), RETRY_MS);
    }
  }

  private async choose(kind: CalibrationKind): Promise<void> {
    this.failed = null;
    try {
      this.fields = await recipeFields(kind.recipe);
      this.values = {
        kind: kind.kind,
        ...Object.fromEntries(this.fields.map((one) => [one.name, one.otherwise ?? null])),
      };
      this.chosen = kind;
    } catch (error) {
      this.failed = error;
    }
  }

  override render() {
    return html`<h1>${t("screen.calibration")}</h1>
      ${this.failed ? saidOf(this.failed) : nothing} ${this.running()} ${this.kindChoice()}
      ${this.chosen ? this.steps(this.chosen) : nothing}
      <section class="card" aria-labelledby="sets">
        <h2 id="sets">${t("sets.title")}</h2>
        <p>${t("sets.why")}</p>
        <calibration-sets></calibration-sets>
      </section>
      <h2>${t("calibration.in_use")}</h2>
      ${
        live.rig
          ? html`<section class="card" aria-labelledby="checks">
              <h3 id="checks">${t("check.title")}</h3>
              ${calibrationChecks(live.rig)}
            </section>`
          : nothing
      }
      <calibration-values></calibration-values>`;
  }

  /** A link back to the calibration under way. */
  private running() {
    const holder = live.holder;
    if (!holder || holder.recipe.kind === "capture") return nothing;
    return html`<p class="notice">
      <a id="running-calibration" href=${`#/sessions/${holder.id}`}>${t("wizard.running")}</a>
    </p>`;
  }

  private kindChoice() {
    return html`<fieldset class="card presets" id="kinds">
      <legend>1. ${t("wizard.kind")}</legend>
      ${this.kinds.map(
        (one) =>
          html`<label class="preset"
            ><input
              type="radio"
              name="kind"
              value=${one.kind}
              .checked=${one.kind === this.chosen?.kind}
              @change=${() => void this.choose(one)}
            /><b>${tOr(`kind.${one.kind}`, one.kind)}</b><small>${tOr(`kind.${one.kind}.why`, one.explanation)}</small
            ><small
              >${
                one.age_days === null
                  ? t("wizard.never")
                  : t("wizard.last", { days: number(one.age_days, one.age_days < 10 ? 1 : 0) })
              }</small
            ></label
          >`,
      )}
    </fieldset>`;
  }

  private steps(kind: CalibrationKind) {
    // A check of the lamp needs the lamp on the flange; with its other target it needs the board.
    const tool = this.values["target"] === "plane" ? "lamp" : kind.tool;
    const mounted = live.rig?.tool === tool;
    const others = (live.rig?.reasons ?? []).filter(({ code }) => code !== "rig.other_tool");
    return html`<section class="card" aria-labelledby="wizard-mount">
        <h2 id="wizard-mount">2. ${t("wizard.mount", { tool: t(`tool.${tool}`) })}</h2>
        <p>${t(`mount.${tool}`)}</p>
        <tool-statement .needed=${tool}></tool-statement>
      </section>
      <div class="split">
        <section class="card" aria-labelledby="wizard-look">
          <h2 id="wizard-look">3. ${t("wizard.look")}</h2>
          ${tool === "board" ? html`<p>${t("wizard.look.why")}</p>` : nothing}
          <target-preview .board=${tool === "board"}></target-preview>
        </section>
        <form
          class="card"
          id="calibration"
          aria-labelledby="wizard-go"
          @submit=${(event: Event) => void this.start(event)}
        >
          <h2 id="wizard-go">4. ${t("wizard.go")}</h2>
          <p>${t("wizard.go.why")}</p>
          ${
            kind.recipe === "BoardRecipe" && live.mayOperate
              ? html`<first-views .recipe=${this.recipe()}></first-views>`
              : nothing
          }
          <recipe-form
            .fields=${this.fields}
            .values=${this.values}
            .errors=${this.fieldErrors()}
            @values=${(event: CustomEvent<Values>) => (this.values = event.detail)}
          ></recipe-form>
          ${others.map(({ detail }) => html`<p class="notice warning">${detail}</p>`)}
          ${
            live.mayOperate
              ? html`<button
                    class="primary large"
                    id="start-calibration"
                    ?disabled=${this.starting || !mounted || whyNoMove() !== null}
                  >
                    ${t("start.start")}</button
                  >${reasonShown(whyNoMove())}`
              : html`<p class="notice">${t("viewer.only_looks")}</p>`
          }
          ${mounted ? nothing : html`<p class="caption">${t("wizard.first_mount")}</p>`}
        </form>
      </div>`;
  }

  private fieldErrors(): Record<string, string> {
    if (!(this.failed instanceof Refusal)) return {};
    return Object.fromEntries((this.failed.problem.errors ?? []).map(({ field, message }) => [field, message]));
  }

  /** The values without the empty ones, for which the service's defaults apply. */
  private recipe(): Values {
    return Object.fromEntries(Object.entries(this.values).filter(([, value]) => value !== null));
  }

  private async start(event: Event): Promise<void> {
    event.preventDefault();
    this.starting = true;
    this.failed = null;
    try {
      await create(this.recipe(), true);
    } catch (error) {
      this.failed = error;
    }
    this.starting = false;
  }
}
