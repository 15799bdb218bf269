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

/** Sessions of a page of the list, and at most at once. */
const PAGE = 50;
const LARGEST_PAGE = 200;

/** Sessions that were found, by what, and whether by a search. */
interface Found extends Page<Session> {
  filter: string;
  searched: boolean;
}

@customElement("sessions-screen")
export class SessionsScreen extends PageElement {
  @state() private wanted = { text: "", state: "", since: "" };
  @state() private deleting: string | null = null;
  protected readonly watching = new LiveController(this);
  private readonly reading = new Reading<Found>(this, () => this.read(), {
    // Progress and stages are not shown here.
    again: ({ type }) => /^(session\.(?!progress|stage)|normals\.)/.test(type),
  });

  /** What the service is asked for: it filters, so that old sessions are found too. */
  private get filter(): string {
    const query = new URLSearchParams();
    const { text, state: wanted, since } = this.wanted;
    if (text) query.set("label", text);
    if (wanted) query.set("state", wanted);
    if (since) query.set("since", new Date(`${since}T00:00`).toISOString());
    return query.toString();
  }

  /** Reads the list, at least as far as it is shown: an event must not take away what a person has asked for. */
  private async read(): Promise<Found> {
    const { filter } = this;
    const searched = Object.values(this.wanted).some(Boolean);
    const { found } = this.reading;
    const shown = found?.filter === filter ? found.items.length : 0;
    const limit = Math.min(Math.max(PAGE, shown), LARGEST_PAGE);
    const items: Session[] = [];
    let next: string | null = `/v1/sessions?limit=${limit}&${filter}`;
    do {
      const page: Page<Session> = await get<Page<Session>>(next);
      items.push(...page.items);
      next = page.next;
    } while (next !== null && items.length < shown);
    return { items, next, filter, searched };
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
