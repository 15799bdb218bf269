/** All sessions: search by label, state and date; open, rename, delete. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { attempt } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { Reading } from "../connection/reading";
import { get, send } from "../connection/requests";
import type { Page, Session } from "../connection/schemas";
import { download } from "../parts/downloads";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { readingState } from "../parts/reading-state";
import { degrees, t, type Word, when } from "../words/language";
import { sessionName } from "../words/names";

const STATES = ["created", "running", "paused", "interrupted", "completed", "stopped", "failed"] as const;

/** Sessions that were found, and whether by a search. */
interface Found extends Page<Session> {
  searched: boolean;
}

@customElement("sessions-screen")
export class SessionsScreen extends PageElement {
  @state() private wanted = { text: "", state: "", since: "" };
  @state() private deleting: string | null = null;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading<Found>(this, () => this.read(), {
    again: ({ type }) => type.startsWith("session."),
  });

  /** The list's address. The service filters, so that old sessions are found too. */
  private get address(): string {
    const query = new URLSearchParams({ limit: "50" });
    const { text, state: wanted, since } = this.wanted;
    if (text) query.set("label", text);
    if (wanted) query.set("state", wanted);
    if (since) query.set("since", new Date(`${since}T00:00`).toISOString());
    return `/v1/sessions?${query.toString()}`;
  }

  private async read(): Promise<Found> {
    const searched = Object.values(this.wanted).some(Boolean);
    return { ...(await get<Page<Session>>(this.address)), searched };
  }

  private async more(): Promise<void> {
    const before = this.reading.found!;
    await attempt(t("sessions.more"), async () => {
      const page = await get<Page<Session>>(before.next!);
      // If the list has been read anew meanwhile, this page must not be appended to it.
      if (this.reading.found === before)
        this.reading.found = { ...before, ...page, items: [...before.items, ...page.items] };
    });
    this.requestUpdate();
  }

  override render() {
    const { found } = this.reading;
    return html`<h1>${t("screen.sessions")}</h1>
      ${this.search()} ${readingState(this.reading)} ${found ? this.shown(found) : nothing}`;
  }

  private shown({ items, next, searched }: Found) {
    return html`${listTable(
      t("screen.sessions"),
      this.columns,
      items.map((session) => this.row(session)),
    )}
    ${items.length === 0 && this.reading.failed === null ? html`<p role="status">${t(searched ? "sessions.no_match" : "sessions.none")}</p>` : nothing}
    ${next ? html`<button type="button" @click=${() => void this.more()}>${t("sessions.more")}</button>` : nothing}`;
  }

  private get columns(): string[] {
    const columns = [t("sessions.number"), t("recipe.label"), t("sessions.state"), t("sessions.created")];
    columns.push(t("sessions.images"), t("sessions.sigma"));
    if (live.mayDelete) columns.push(t("sessions.actions"));
    return columns;
  }

  private search() {
    const put = (name: "text" | "state" | "since") => (event: Event) => {
      this.wanted = { ...this.wanted, [name]: (event.target as HTMLInputElement).value };
      this.reading.restart(false);
    };
    return html`<form class="search" role="search" @submit=${(event: Event) => event.preventDefault()}>
      <label>${t("sessions.search")}<input type="search" .value=${this.wanted.text} @input=${put("text")} /></label>
      <label
        >${t("sessions.state")}<select @change=${put("state")}>
          <option value="">${t("sessions.any")}</option>
          ${STATES.map((one) => html`<option value=${one}>${t(`state.${one}` as Word)}</option>`)}
        </select></label
      >
      <label>${t("sessions.since")}<input type="date" .value=${this.wanted.since} @input=${put("since")} /></label>
    </form>`;
  }

  private row(session: Session) {
    const summary = session.answer?.summary;
    return html`<tr data-session=${session.id}>
      <td>${session.number}</td>
      <td>
        <a href=${`#/sessions/${session.id}${session.answer ? "/result" : ""}`}>${sessionName(session)}</a>
      </td>
      <td><span class=${`badge ${session.state}`}>${t(`state.${session.state}` as Word)}</span></td>
      <td>${when(session.created)}</td>
      <td>${summary?.images ?? "–"}</td>
      <td>${degrees(summary?.mean_sigma_deg)}</td>
      ${live.mayDelete ? html`<td>${this.deletion(session)}</td>` : nothing}
    </tr>`;
  }

  private deletion(session: Session) {
    const archive = html`<button
      type="button"
      class="link"
      @click=${() => void download(`/v1/sessions/${session.id}/archive`, `${session.id}.zip`)}
    >
      ${t("sessions.archive")}
    </button>`;
    if (live.rig?.holder === session.id) return archive;
    if (this.deleting !== session.id)
      return html`${archive}
        <button type="button" class="link" @click=${() => (this.deleting = session.id)}>
          ${t("sessions.delete")}
        </button>`;
    return html`<span role="group" aria-label=${t("sessions.delete")}>
      ${t("sessions.delete_really")}
      <button type="button" class="danger" @click=${() => void this.discard(session)}>${t("sessions.delete")}</button>
      <button type="button" @click=${() => (this.deleting = null)}>${t("cancel")}</button>
    </span>`;
  }

  private async discard(session: Session): Promise<void> {
    await attempt(t("sessions.delete"), () => send("DELETE", `/v1/sessions/${session.id}`));
    this.deleting = null;
    void this.reading.load();
  }
}
