/** The queue: sessions of named objects in turn. A person states when the next object is in place. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { attempt, attemptMove } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { Reading } from "../connection/reading";
import { get, post, send } from "../connection/requests";
import type { Queue, QueueEntry } from "../connection/schemas";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { reasonShown, whyNoMove } from "../parts/move-reason";
import { readingState } from "../parts/reading-state";
import { t, type Word, when } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

@customElement("queue-screen")
export class QueueScreen extends PageElement {
  @state() private asking = false;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading(this, () => get<Queue>("/v1/queue"), {
    again: ({ type }) => /^(queue|session)\./.test(type),
  });

  override render() {
    const queue = this.reading.found;
    return html`<h1>${t("screen.queue")}</h1>
      <p>${t("queue.why")}</p>
      ${readingState(this.reading)} ${queue ? this.shown(queue) : nothing}`;
  }

  private shown(queue: Queue) {
    return html`${this.state(queue)}
    ${
      queue.entries.length === 0
        ? html`<p>${t("queue.empty")} <a href="#/start">${t("screen.start")}</a></p>`
        : this.table(queue)
    }`;
  }

  private state(queue: Queue) {
    const running = queue.state === "running";
    return html`<div class=${queue.reason ? "notice warning" : "notice"} id="queue-state" data-state=${queue.state}>
      <b>${t(running ? "queue.running" : "queue.stopped")}</b>
      ${
        queue.changed // null: nobody has changed it yet
          ? html`<small>${queue.changed_by} · ${when(queue.changed)}</small>`
          : nothing
      }
      ${
        queue.reason
          ? html`<p>
              ${problemTitle(queue.reason.code, queue.reason.title)}: ${queue.reason.detail}.
              ${remedyOf(queue.reason.code, queue.reason.remedy)}
            </p>`
          : nothing
      }
      ${live.mayOperate ? this.actions(queue, running) : nothing}
    </div>`;
  }

  private actions(queue: Queue, running: boolean) {
    if (running) return html`<button type="button" @click=${() => void this.pause()}>${t("queue.pause")}</button>`;
    if (queue.next_object === null) return nothing;
    const why = whyNoMove();
    if (!this.asking)
      return html`<button type="button" class="primary" ?disabled=${why !== null} @click=${() => (this.asking = true)}>
          ${t("queue.resume")}</button
        >${reasonShown(why)}`;
    return html`<div class="question" role="group" aria-label=${t("queue.resume")}>
      <p>${t("queue.question", { name: queue.next_object })}</p>
      <button type="button" class="primary" ?disabled=${why !== null} @click=${() => void this.resume(queue)}>
        ${t("queue.confirm")}
      </button>
      <button type="button" @click=${() => (this.asking = false)}>${t("cancel")}</button>
    </div>`;
  }

  private table(queue: Queue) {
    const waiting = queue.entries.filter((entry) => entry.state === "waiting");
    const columns = [t("queue.object"), t("sessions.state"), t("start.lights"), t("queue.added")];
    if (live.mayOperate) columns.push(t("sessions.actions"));
    return listTable(
      t("screen.queue"),
      columns,
      queue.entries.map((entry) => this.row(entry, waiting)),
    );
  }

  private row(entry: QueueEntry, waiting: QueueEntry[]) {
    const place = waiting.indexOf(entry);
    const { pilot_lights: pilot, planned_lights: planned } = entry.recipe;
    return html`<tr data-entry=${entry.id}>
      <td>
        ${
          entry.session_id
            ? html`<a href=${`#/sessions/${entry.session_id}`}>${entry.object_name}</a>`
            : entry.object_name
        }
        ${entry.unattended ? html`<small>${t("queue.unattended")}</small>` : nothing}
      </td>
      <td>${t(`entry.${entry.state}` as Word)}</td>
      <td>${pilot} + ${planned}</td>
      <td>${entry.added_by}</td>
      ${
        live.mayOperate
          ? html`<td>
              ${
                place > 0
                  ? html`<button type="button" class="link" @click=${() => void this.raise(waiting, place)}>
                      ${t("queue.up")}
                    </button>`
                  : nothing
              }
              ${
                entry.state === "running"
                  ? nothing
                  : html`<button type="button" class="link" @click=${() => void this.omit(entry)}>
                      ${t("queue.remove")}
                    </button>`
              }
            </td>`
          : nothing
      }
    </tr>`;
  }

  private async resume(queue: Queue): Promise<void> {
    const next = queue.entries.find((entry) => entry.state === "waiting");
    // Named, so that after a change of the order no session of another object begins.
    const body = next ? { action: "resume", entry: next.id } : { action: "resume" };
    this.asking = false;
    await attemptMove(t("queue.confirm"), (options) => post("/v1/queue/actions", body, options()));
    await this.reading.load();
  }

  private async pause(): Promise<void> {
    await this.change(t("queue.pause"), () => post("/v1/queue/actions", { action: "pause" }));
  }

  private async raise(waiting: QueueEntry[], place: number): Promise<void> {
    const entries = waiting.map((entry) => entry.id);
    entries.splice(place - 1, 0, ...entries.splice(place, 1));
    await this.change(t("queue.up"), () => send("PUT", "/v1/queue/order", { body: { entries } }));
  }

  private async omit(entry: QueueEntry): Promise<void> {
    await this.change(t("queue.remove"), () => send("DELETE", `/v1/queue/entries/${entry.id}`));
  }

  private async change(name: string, request: () => Promise<unknown>): Promise<void> {
    await attempt(name, request);
    await this.reading.load();
  }
}
