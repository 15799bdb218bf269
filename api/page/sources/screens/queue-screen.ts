/** The queue: sessions that run one after another, each of a named object; a person says when the next object is in place. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { JournalController, live, LiveController } from "../connection/live";
import { get, post, send } from "../connection/requests";
import type { Queue, QueueEntry } from "../connection/schemas";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { t, type Word, when } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

@customElement("queue-screen")
export class QueueScreen extends PageElement {
  @state() private queue: Queue | null = null;
  @state() private asking = false;
  protected readonly watching = new LiveController(this);
  protected readonly hearing = new JournalController(this, ({ type }) => {
    if (/^(queue|session)\./.test(type)) void this.load();
  });

  override connectedCallback(): void {
    super.connectedCallback();
    void this.load();
  }

  private async load(): Promise<void> {
    try {
      this.queue = await get<Queue>("/v1/queue");
    } catch (error) {
      live.fail(error);
    }
  }

  override render() {
    const { queue } = this;
    if (!queue) return html`<h1>${t("screen.queue")}</h1>`;
    return html`<h1>${t("screen.queue")}</h1>
      <p>${t("queue.why")}</p>
      ${this.state(queue)}
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
        Date.parse(queue.changed) > 0 // the epoch: nobody has changed it yet
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
    if (running) return html`<button type="button" @click=${() => void this.act("pause")}>${t("queue.pause")}</button>`;
    if (queue.next_object === null) return nothing;
    if (!this.asking)
      return html`<button type="button" class="primary" @click=${() => (this.asking = true)}>
        ${t("queue.resume")}
      </button>`;
    return html`<div class="question" role="group" aria-label=${t("queue.resume")}>
      <p>${t("queue.question", { name: queue.next_object })}</p>
      <button type="button" class="primary" @click=${() => void this.act("resume")}>${t("queue.confirm")}</button>
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

  private async act(action: "resume" | "pause"): Promise<void> {
    const next = this.queue?.entries.find((entry) => entry.state === "waiting");
    // Named, so that an order that was changed meanwhile does not begin another object's session.
    const body = action === "resume" && next ? { action, entry: next.id } : { action };
    this.asking = false;
    await this.change(() => post("/v1/queue/actions", body));
  }

  private async raise(waiting: QueueEntry[], place: number): Promise<void> {
    const entries = waiting.map((entry) => entry.id);
    entries.splice(place - 1, 0, ...entries.splice(place, 1));
    await this.change(() => send("PUT", "/v1/queue/order", { body: { entries } }));
  }

  private async omit(entry: QueueEntry): Promise<void> {
    await this.change(() => send("DELETE", `/v1/queue/entries/${entry.id}`));
  }

  private async change(request: () => Promise<unknown>): Promise<void> {
    try {
      await request();
      live.fail(null);
    } catch (error) {
      live.fail(error);
    }
    await this.load();
  }
}
