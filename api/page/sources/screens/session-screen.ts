/** One session: its state and actions, and its progress, plan or result. */
import { html, nothing, type PropertyValues } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { act, edit } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { get } from "../connection/requests";
import type { Action as Taken, Session } from "../connection/schemas";
import { type Suspension, suspensionBeforeStop } from "../connection/suspension";
import { PageElement } from "../parts/element";
import { reasonShown, whyNoMove } from "../parts/move-reason";
import { duration, percent, t, type Word, when } from "../words/language";
import { sessionName } from "../words/names";
import { problemTitle, remedyOf } from "../words/problems";
import "./calibration-progress";
import "./plan-review";
import "./result-view";
import "./session-progress";

const PARTS = ["", "plan", "result"];
/** Parts of a calibration session's screen. */
const CALIBRATION_PARTS = ["", "images"];
type Action = Session["allowed_actions"][number];
const ASKED = new Set<Action>(["resume", "stop"]);
const MOVES = new Set<Action>(["start", "resume"]);

@customElement("session-screen")
export class SessionScreen extends PageElement {
  @property({ attribute: false }) identity: string | null = null;
  @property({ attribute: false }) chapter = "";
  @state() private asked: Action | null = null;
  @state() private fromHere = false;
  @state() private editing = false;
  protected readonly watching = new LiveController(this);
  @state() private stopped: Taken | null = null;
  @state() private suspended: Suspension | null = null;
  private asking = "";

  /** A question is about one session in one state. What was ticked for it does not apply to another. */
  override willUpdate(changed: PropertyValues<this>): void {
    if (changed.has("identity")) this.editing = false;
    const session = this.identity ? live.session(this.identity) : null;
    const asking = [this.identity, session?.state, session?.reason?.code].join();
    if (asking === this.asking) return;
    this.asking = asking;
    this.ask(null);
    this.stopped = this.suspended = null;
    if (session?.state === "stopped") void this.readStop(session.id);
  }

  /** Reads who stopped a session, and why it waited then. Without an answer the screen states only that it is stopped. */
  private async readStop(id: string): Promise<void> {
    const [{ items }, suspended] = await Promise.all([
      get<{ items: Taken[] }>(`/v1/sessions/${id}/actions?limit=200`).catch(() => ({ items: [] })),
      suspensionBeforeStop(id).catch(() => null),
    ]);
    if (this.identity !== id) return;
    this.suspended = suspended;
    const done = items.filter(({ outcome }) => outcome !== "refused");
    // A halt of the cell stops the session too; it says more.
    const stops = ["halt", "stop"].map((name) => done.filter(({ action }) => action === name).at(-1));
    this.stopped = stops[0] ?? stops[1] ?? null;
  }

  private ask(action: Action | null): void {
    this.asked = action;
    this.fromHere = false;
  }

  override render() {
    if (!this.identity)
      return html`<h1>${t("screen.session")}</h1>
        <p>${t("session.none")} <a href="#/start">${t("screen.start")}</a></p>`;
    const session = live.session(this.identity);
    if (!session)
      return html`<h1>${t("screen.session")}</h1>
        <p role="status">${live.isMissing(this.identity) ? t("session.missing") : t("loading")}</p>`;
    return html`<div class="title">
        <h1>${sessionName(session)}</h1>
        <span class=${`badge ${session.state}`} id="session-state" data-state=${session.state}
          >${t(`state.${session.state}` as Word)}</span
        >
        <small>${t("session")} ${session.number} · ${when(session.created)} · ${session.cell}</small>
        ${
          live.mayOperate && !this.editing
            ? html`<button type="button" class="link" @click=${() => (this.editing = true)}>
                ${t("session.edit")}
              </button>`
            : nothing
        }
      </div>
      ${this.editing ? this.form(session) : session.notes ? html`<p class="notes">${session.notes}</p>` : nothing}
      ${this.reason(session)} ${session.conclusion ? html`<p class="notice">${session.conclusion}</p>` : nothing}
      ${this.actions(session)}
      <nav class="tabs" aria-label=${t("session.parts")}>
        ${(session.recipe.kind === "capture" ? PARTS : CALIBRATION_PARTS).map(
          (part) =>
            html`<a
              href=${`#/sessions/${session.id}${part ? `/${part}` : ""}`}
              aria-current=${part === this.chapter ? "page" : nothing}
              >${t(`part.${part || "progress"}` as Word)}</a
            >`,
        )}
      </nav>
      ${this.shown(session)}`;
  }

  private form(session: Session) {
    const save = async (event: Event): Promise<void> => {
      event.preventDefault();
      const given = new FormData(event.target as HTMLFormElement);
      const change = { label: String(given.get("label")), notes: String(given.get("notes")) };
      // What could not be saved stays in the form.
      if (await edit(t("session.save"), session.id, change)) this.editing = false;
    };
    return html`<form class="card" @submit=${(event: Event) => void save(event)}>
      <div class="field">
        <label for="edit-label">${t("recipe.label")}</label>
        <input id="edit-label" name="label" maxlength="200" .value=${session.label} />
      </div>
      <div class="field">
        <label for="edit-notes">${t("recipe.notes")}</label>
        <textarea id="edit-notes" name="notes" rows="3" maxlength="10000" .value=${session.notes}></textarea>
      </div>
      <div class="actions">
        <button class="primary">${t("session.save")}</button>
        <button type="button" @click=${() => (this.editing = false)}>${t("cancel")}</button>
      </div>
    </form>`;
  }

  private shown(session: Session) {
    if (session.recipe.kind !== "capture" && this.chapter !== "images")
      return html`<calibration-progress .session=${session}></calibration-progress>`;
    if (this.chapter === "plan") return html`<plan-review .session=${session}></plan-review>`;
    if (this.chapter === "result") return html`<result-view .session=${session}></result-view>`;
    return html`<session-progress .session=${session}></session-progress>`;
  }

  private reason(session: Session) {
    const reason = session.reason;
    if (!reason && this.stopped) {
      const { action, actor, at } = this.stopped;
      return html`<p id="session-stopped">
          ${t(action === "halt" ? "session.by_halt" : "session.by_stop", { name: actor, when: when(at) })}
        </p>
        ${this.suspended ? this.suspension(this.suspended) : nothing}`;
    }
    if (!reason) return nothing;
    const toReview = reason.code === "plan.to_review";
    return html`<div class=${`notice ${toReview ? "" : "warning"}`} id="session-reason">
      <b>${problemTitle(reason.code, reason.title)}</b>
      <p>${reason.detail}. ${remedyOf(reason.code, reason.remedy)}</p>
      ${toReview && this.chapter !== "plan" ? html`<a class="button" href=${`#/sessions/${session.id}/plan`}>${t("session.review")}</a>` : nothing}
    </div>`;
  }

  /** Its remedies are left out: they end in resuming, which is no longer possible. */
  private suspension({ state, reason }: Suspension) {
    const title = problemTitle(reason.code, reason.title);
    return html`<div class="notice warning" id="session-before">
      <b>${t("session.before", { state: t(`state.${state}` as Word) })} ${title}</b>
      <p>${reason.detail}.</p>
    </div>`;
  }

  private actions(session: Session) {
    const more = session.state === "running" && session.seconds_left !== null;
    // A plan under review is accepted beside its lights, because here a change of them would be lost.
    const offered = session.allowed_actions.filter(
      (action) => action !== "resume" || session.reason?.code !== "plan.to_review",
    );
    const moves = live.mayOperate && offered.some((action) => MOVES.has(action));
    return html`<div class="actions">
      ${
        session.state === "running"
          ? html`<progress max="1" .value=${session.progress} aria-label=${t("session.progress")}></progress
              ><span>${percent(session.progress)}${more ? ` · ${duration(session.seconds_left)}` : ""}</span>`
          : nothing
      }
      ${live.mayOperate ? offered.map((action) => this.action(session, action)) : nothing}
      ${moves ? reasonShown(whyNoMove()) : nothing}
      ${this.asked && session.allowed_actions.includes(this.asked) ? this.question(session, this.asked) : nothing}
    </div>`;
  }

  private action(session: Session, action: Action) {
    return html`<button
      type="button"
      data-action=${action}
      class=${MOVES.has(action) ? "primary" : ""}
      ?disabled=${MOVES.has(action) && whyNoMove() !== null}
      @click=${() => (ASKED.has(action) ? this.ask(action) : void act(session.id, action))}
    >
      ${t(`action.${action}` as Word)}
    </button>`;
  }

  private question(session: Session, action: Action) {
    const elsewhere = session.state === "interrupted" && action === "resume";
    return html`<div class="question" role="group" aria-label=${t(`action.${action}` as Word)}>
      <p>${t(`ask.${action}` as Word)}</p>
      ${
        elsewhere
          ? html`<label
              ><input
                type="checkbox"
                .checked=${this.fromHere}
                @change=${(event: Event) => (this.fromHere = (event.target as HTMLInputElement).checked)}
              />
              ${t("ask.from_here")}</label
            >`
          : nothing
      }
      <button
        type="button"
        class="primary"
        data-confirm=${action}
        ?disabled=${MOVES.has(action) && whyNoMove() !== null}
        @click=${() => {
          const more = elsewhere && this.fromHere ? { from_here: true } : {};
          this.ask(null);
          void act(session.id, action, more);
        }}
      >
        ${t(`action.${action}` as Word)}
      </button>
      <button type="button" @click=${() => this.ask(null)}>${t("cancel")}</button>
    </div>`;
  }
}
