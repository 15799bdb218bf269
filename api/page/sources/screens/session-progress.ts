/** The progress of a session: stages, time left, images as they arrive, and events in words. */
import { html, nothing } from "lit";
import { customElement, property } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { ofSession, Reading } from "../connection/reading";
import { all, get } from "../connection/requests";
import type { JournalEvent, Pass, PassSummary, Session, Shot } from "../connection/schemas";
import { PageElement } from "../parts/element";
import { readingState } from "../parts/reading-state";
import "../parts/api-picture";
import { clock, duration, milliseconds, percent, t, tOr, type Word } from "../words/language";
import { imageName, stageName } from "../words/names";

const STAGES = ["pilot", "waypoints", "capture", "normals", "plan"] as const;
/** Stages of a calibration session. */
const CALIBRATION_STAGES = ["plan", "waypoints", "capture", "estimate"] as const;
/** Share of clipped pixels above which it is mentioned. */
const CLIPPED_SHARE = 0.005;
/** Number of events shown, newest first. */
const SHOWN_EVENTS = 60;
/** Types of events that are not shown, because the screen displays their content elsewhere. */
const UNTOLD = new Set(["session.progress"]);

@customElement("session-progress")
export class SessionProgress extends PageElement {
  @property({ attribute: false }) session!: Session;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading<Pass[]>(
    this,
    async () => {
      const address = `/v1/sessions/${this.session.id}/passes`;
      const summaries = await all<PassSummary>(address);
      return Promise.all(summaries.map(({ number: one }) => get<Pass>(`${address}/${one}`)));
    },
    ofSession(this, /^(shot|shots|plan|waypoints|normals)\./),
  );

  override render() {
    const { session } = this;
    const passes = this.reading.found;
    const lit = passes?.flatMap((pass) => pass.shots).filter(({ shot }) => shot.kind === "light").length;
    return html`<ol class="stages" aria-label=${t("progress.stages")}>
        ${(session.recipe.kind === "capture" ? STAGES : CALIBRATION_STAGES).map(
          (stage) =>
            html`<li
              aria-current=${session.state === "running" && session.stage === stage ? "step" : nothing}
              class=${session.stage === stage ? "now" : ""}
            >
              ${stageName(session, stage)}
            </li>`,
        )}
      </ol>
      <dl class="figures">
        <div>
          <dt>${t("progress.images")}</dt>
          <dd id="image-count">${lit ?? "–"}</dd>
        </div>
        <div>
          <dt>${t("progress.done")}</dt>
          <dd>${percent(session.progress)}</dd>
        </div>
        <div>
          <dt>${t("progress.left")}</dt>
          <dd>${duration(session.seconds_left)}</dd>
        </div>
        <div>
          <dt>${t("progress.arm")}</dt>
          <dd class="words">${t(`arm.${session.state}` as Word)}</dd>
        </div>
      </dl>
      ${readingState(this.reading)} ${passes?.map((pass) => this.pass(pass))}
      <h2>${t("progress.happened")}</h2>
      ${this.events()}`;
  }

  private pass(pass: Pass) {
    const title = pass.plan.method === "pilot" ? t("progress.pilot") : t("progress.pass", { number: pass.number });
    const lit = pass.shots.filter(({ shot }) => shot.kind === "light").length;
    return html`<section aria-label=${title}>
      <h2>${title} <small>${t("progress.of", { done: lit, total: pass.plan.lights.length })}</small></h2>
      <ul class="images">
        ${pass.shots.map(({ shot, links }) => {
          const { warnings, name } = this.words(shot);
          return html`<li>
            <figure class=${warnings.length ? "doubtful" : ""}>
              <api-picture .address=${links["thumbnail"] ?? links["image"]!} .alternative=${name}></api-picture>
              <figcaption>
                ${name}<small>${milliseconds(shot.exposure_s)}</small>
                ${warnings.map((warning) => html`<small class="warns">${warning}</small>`)}
              </figcaption>
            </figure>
          </li>`;
        })}
      </ul>
    </section>`;
  }

  private words(shot: Shot): { name: string; warnings: string[] } {
    const name =
      shot.kind === "light"
        ? imageName(this.session, shot.light_number ?? 0)
        : t(shot.kind === "dark" ? "progress.dark" : "progress.repeat");
    const warnings: string[] = [];
    if (shot.attempt > 0) warnings.push(t("progress.retaken", { count: shot.attempt }));
    if (shot.quality.saturated > CLIPPED_SHARE)
      warnings.push(t("progress.clipped", { share: percent(shot.quality.saturated, 1) }));
    if (shot.quality.reason) warnings.push(shot.quality.reason);
    return { name, warnings };
  }

  private events() {
    const { id } = this.session;
    const events = live.events.filter(
      ({ session_id, type }) => (session_id === id || session_id === null) && !UNTOLD.has(type),
    );
    if (events.length === 0) return html`<p class="caption">${t("progress.nothing_yet")}</p>`;
    return html`<ol class="events" reversed tabindex="0" aria-label=${t("progress.happened")}>
      ${events
        .slice(-SHOWN_EVENTS)
        .reverse()
        .map(
          (event) =>
            html`<li data-event=${event.id} class=${warns(event) ? "warns" : ""}>
              <time>${clock(event.at)}</time> ${this.said(event)}
            </li>`,
        )}
    </ol>`;
  }

  private said({ type, body }: JournalEvent): string {
    const { session } = this;
    if (type === "session.state") return `${t(`state.${String(body["state"])}` as Word)} (${String(body["by"] ?? "")})`;
    if (type === "session.stage") return stageName(session, String(body["stage"]));
    if (type === "shot.captured") {
      const what = { dark: t("progress.dark"), reference: t("progress.repeat") }[String(body["kind"])];
      return `${t("event.shot.captured")}: ${what ?? imageName(session, Number(body["light_number"]))}`;
    }
    if (type === "camera.fault") {
      const again = body["retaken"] ? `, ${t("camera.retaken")}` : "";
      return `${t("event.camera.fault")}: ${tOr(`camera.${String(body["kind"])}`, "")}${again} (${String(body["detail"])})`;
    }
    const calibrates = session.recipe.kind !== "capture" && tOr(`event.calibration.${type}`, "");
    const reason = body["reason"] ?? body["detail"] ?? body["outcome"];
    return `${calibrates || tOr(`event.${type}`, type)}${reason ? `: ${String(reason)}` : ""}`;
  }
}

/** Whether an event reports a fault of the camera, and not its return. */
function warns({ type, body }: JournalEvent): boolean {
  return type === "camera.fault" && body["kind"] !== "returned";
}
