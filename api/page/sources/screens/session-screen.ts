/** One session: what it does and may do, and its progress, plan or result. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { act, edit } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import type { Session } from "../connection/schemas";
import { PageElement } from "../parts/element";
import { duration, percent, t, type Word, when } from "../words/language";
import { sessionName } from "../words/names";
import { problemTitle, remedyOf } from "../words/problems";
import "./calibration-progress";
import "./plan-review";
import "./result-view";
import "./session-progress";

const PARTS = ["", "plan", "result"];
/** Of a session that calibrates. */
const CALIBRATION_PARTS = ["", "images"];
type Action = Session["allowed_actions"][number];
const ASKED = new Set<Action>(["resume", "stop"]);

@customElement("session-screen")
export class SessionScreen extends PageElement {
  @property({ attribute: false }) identity: string | null = null;
  @property({ attribute: false }) chapter = "";
  @state() private asked: Action | null = null;
  @state() private fromHere = false;
  @state() private editing = false;
  protected readonly watching = new LiveController(this);

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
      await edit(session.id, { label: String(given.get("label")), notes: String(given.get("notes")) });
      this.editing = false;
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
    if (!reason) return nothing;
    const toReview = reason.code === "plan.to_review";
    return html`<div class=${`notice ${toReview ? "" : "warning"}`} id="session-reason">
      <b>${problemTitle(reason.code, reason.title)}</b>
      <p>${reason.detail}. ${remedyOf(reason.code, reason.remedy)}</p>
      ${toReview && this.chapter !== "plan" ? html`<a class="button" href=${`#/sessions/${session.id}/plan`}>${t("session.review")}</a>` : nothing}
    </div>`;
  }

  private actions(session: Session) {
    const more = session.state === "running" && session.seconds_left !== null;
    return html`<div class="actions">
      ${
        session.state === "running"
          ? html`<progress max="1" .value=${session.progress} aria-label=${t("session.progress")}></progress
              ><span>${percent(session.progress)}${more ? ` · ${duration(session.seconds_left)}` : ""}</span>`
          : nothing
      }
      ${
        live.mayOperate
          ? session.allowed_actions
              // A plan under review is accepted where its lights stand, or a change of them would be lost.
              .filter((action) => action !== "resume" || session.reason?.code !== "plan.to_review")
              .map((action) => this.action(session, action))
          : nothing
      }
      ${this.asked && session.allowed_actions.includes(this.asked) ? this.question(session, this.asked) : nothing}
    </div>`;
  }

  private action(session: Session, action: Action) {
    return html`<button
      type="button"
      data-action=${action}
      class=${action === "start" || action === "resume" ? "primary" : ""}
      @click=${() => (ASKED.has(action) ? (this.asked = action) : void act(session.id, action))}
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
        @click=${() => {
          this.asked = null;
          void act(session.id, action, elsewhere && this.fromHere ? { from_here: true } : {});
        }}
      >
        ${t(`action.${action}` as Word)}
      </button>
      <button type="button" @click=${() => (this.asked = null)}>${t("cancel")}</button>
    </div>`;
  }
}
