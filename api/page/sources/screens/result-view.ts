/** A session's results: figures and findings in words, maps, movable light, profile, comparison, downloads. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { attempt, edit } from "../connection/actions";
import { JournalController, live, LiveController } from "../connection/live";
import { ofSession, Reading } from "../connection/reading";
import { all, get, post } from "../connection/requests";
import type { CalibrationSet, Page, Result, Session } from "../connection/schemas";
import { download, openInTab } from "../parts/downloads";
import { PageElement } from "../parts/element";
import { readingState } from "../parts/reading-state";
import { degrees, number, percent, t, tOr, when } from "../words/language";
import "./map-viewer";
import "./result-comparison";

/** Probability of the misfit below which it is reported as too large. */
const FAIR_PROBABILITY = 0.05;

interface Found {
  results: Result[];
  /** Other sessions with an answer. */
  others: Session[];
  calibrations: CalibrationSet[];
}

@customElement("result-view")
export class ResultView extends PageElement {
  @property({ attribute: false }) session!: Session;
  @state() private chosen = -1;
  /** The number of the result that is being solved; null: none. */
  @state() private solved: number | null = null;
  @state() private asking = false;
  private shownFor = "";
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading<Found>(this, () => this.read(), ofSession(this, /^(normals|resolve)\./));
  protected readonly hearing = new JournalController(this, ({ type, session_id }) => {
    if (session_id === this.session.id && type === "resolve.failed") this.solved = null;
  });

  override willUpdate(): void {
    if (this.shownFor === this.session.id) return;
    this.shownFor = this.session.id;
    this.chosen = -1;
    this.solved = null;
  }

  private async read(): Promise<Found> {
    const results = await all<Result>(`/v1/sessions/${this.session.id}/results`);
    const { items } = await get<Page<Session>>("/v1/sessions?limit=30");
    const others = items.filter((session) => session.id !== this.session.id && session.answer !== null);
    if (results.some(({ number }) => number === this.solved)) this.solved = null;
    return { results, others, calibrations: await all<CalibrationSet>("/v1/rig/calibrations") };
  }

  private get shown(): Result | null {
    const results = this.reading.found?.results ?? [];
    const wanted = this.chosen >= 0 ? this.chosen : this.session.answer?.number;
    return results.find((result) => result.number === wanted) ?? results.at(-1) ?? null;
  }

  override render() {
    const { found } = this.reading;
    if (!found) return readingState(this.reading);
    const result = this.shown;
    if (!result)
      return html`${readingState(this.reading)}
        <p role="status">${t("result.none")}</p>`;
    return html`${readingState(this.reading)} ${this.choice(result)} ${this.figures(result)} ${this.findings(result)}
      <map-viewer .result=${result}></map-viewer>
      <result-comparison .result=${result} .results=${found.results} .sessions=${found.others}></result-comparison>
      ${this.session.ended && live.mayOperate ? this.solving(found) : nothing} ${this.downloads(result)}`;
  }

  /** Solves the same images again, with the calibration of the capture or a newer one. */
  private solving({ calibrations }: Found) {
    const solve = async (event: Event): Promise<void> => {
      event.preventDefault();
      const calibration = String(new FormData(event.target as HTMLFormElement).get("calibration")) || null;
      this.asking = true;
      await attempt(t("result.solve"), async () => {
        const { number } = await post<{ number: number }>(`/v1/sessions/${this.session.id}/results`, { calibration });
        const known = this.reading.found?.results.some((result) => result.number === number);
        this.solved = known ? null : number;
        if (known) this.chosen = number; // it was solved before
      });
      this.asking = false;
    };
    const made = calibrations.filter((one) => one.kind !== null);
    return html`<form class="card" id="solve-again" @submit=${(event: Event) => void solve(event)}>
      <label class="field"
        >${t("result.solve_with")}
        <select name="calibration">
          <option value="">${t("result.of_capture")}</option>
          ${made.map(
            (one) => html`<option value=${one.id}>${tOr(`kind.${one.kind}`, one.kind!)}, ${when(one.made_at)}</option>`,
          )}
        </select></label
      >
      <button ?disabled=${this.asking || this.solved !== null}>${t("result.solve")}</button>
      ${this.solved === null ? nothing : html`<p role="status">${t("result.solving", { number: this.solved })}</p>`}
    </form>`;
  }

  private choice(shown: Result) {
    return html`<div class="actions" role="group" aria-label=${t("result.which")}>
      ${this.reading.found!.results.map(
        (result) =>
          html`<button
            type="button"
            aria-pressed=${String(result.number === shown.number)}
            @click=${() => (this.chosen = result.number)}
          >
            ${
              result.origin === "resolve"
                ? t("result.resolved", { number: result.number })
                : result.number === 0 && this.reading.found!.results.length > 1
                  ? t("result.of_pilot")
                  : t("result.number", { number: result.number })
            }
            ${result.number === this.session.answer?.number ? html`<small>${t("result.answer")}</small>` : nothing}
          </button>`,
      )}
      ${
        live.mayOperate && this.session.answer && shown.number !== this.session.answer.number
          ? html`<button
              type="button"
              class="link"
              @click=${() => void edit(t("result.choose"), this.session.id, { answer: shown.number })}
            >
              ${t("result.choose")}
            </button>`
          : nothing
      }
    </div>`;
  }

  private figures(result: Result) {
    const { summary } = result;
    const share = summary.solved_pixels / Math.max(summary.object_pixels, 1);
    return html`<dl class="figures">
      <div>
        <dt>${t("result.images")}</dt>
        <dd>${summary.images}</dd>
      </div>
      <div>
        <dt>${t("result.error")}</dt>
        <dd>${degrees(0.886 * summary.mean_sigma_deg)}</dd>
      </div>
      <div>
        <dt>${t("result.sigma")}</dt>
        <dd id="mean-sigma">${degrees(summary.mean_sigma_deg)}</dd>
      </div>
      ${
        summary.region_sigma_deg == null
          ? nothing
          : html`<div>
              <dt>${t("result.region")}</dt>
              <dd>${degrees(summary.region_sigma_deg)}</dd>
            </div>`
      }
      ${
        summary.predicted_sigma_deg == null
          ? nothing
          : html`<div>
              <dt>${t("result.predicted")}</dt>
              <dd>${degrees(summary.predicted_sigma_deg)}</dd>
            </div>`
      }
      <div>
        <dt>${t("result.solved")}</dt>
        <dd>${percent(share, 1)}</dd>
      </div>
      <div>
        <dt>${t("result.made")}</dt>
        <dd class="words">${when(result.created)}</dd>
      </div>
    </dl>`;
  }

  /** Goodness of fit and findings in words. */
  private findings({ summary }: Result) {
    const fit = summary.fit;
    const findings = summary.findings ?? [];
    const sound = !fit || fit.probability >= FAIR_PROBABILITY;
    const clean = sound && findings.every((one) => one.corrected);
    return html`<section class=${`notice ${clean ? (fit ? "good" : "") : "warning"}`}>
      <b>${t("result.fit")}</b>
      <p>
        ${
          fit
            ? t(sound ? "result.fits" : "result.misfits", {
                misfit: number(fit.misfit, 2),
                probability: percent(fit.probability, fit.probability < 0.01 ? 2 : 0),
              })
            : t("result.fit_unknown")
        }
        ${
          summary.fewer_than_three_lights > 0.02
            ? t("result.few_lights", { share: percent(summary.fewer_than_three_lights) })
            : nothing
        }
      </p>
      ${
        findings.length
          ? html`<ul>
              ${findings.map(
                (finding) =>
                  html`<li>
                    <b>${tOr(`finding.${finding.kind}`, finding.kind)}</b>
                    (${t(finding.corrected ? "result.corrected" : "result.not_corrected")}): ${finding.message}
                  </li>`,
              )}
            </ul>`
          : nothing
      }
    </section>`;
  }

  private downloads(result: Result) {
    const files = [...result.artefacts.map(({ name, href }) => [name, href] as const), ...exported(result)];
    return html`<section class="card" aria-labelledby="downloads">
      <h2 id="downloads">${t("result.downloads")}</h2>
      <div class="actions">
        <button type="button" @click=${() => void openInTab(`${result.links["self"]}/report.html`)}>
          ${t("result.report")}
        </button>
        <button
          type="button"
          @click=${() => void download(`/v1/sessions/${this.session.id}/archive`, `${this.session.id}.zip`)}
        >
          ${t("sessions.archive")}
        </button>
        <button type="button" @click=${() => void openInTab(`/v1/sessions/${this.session.id}/log`)}>
          ${t("result.log")}
        </button>
      </div>
      <ul class="files">
        ${files.map(
          ([name, address]) =>
            html`<li>
              <button type="button" class="link" data-file=${name} @click=${() => void download(address, name)}>
                ${name}
              </button>
            </li>`,
        )}
      </ul>
    </section>`;
  }
}

function exported(result: Result): (readonly [string, string])[] {
  return Object.entries(result.exports ?? {});
}
