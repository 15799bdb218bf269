/** The list of sessions, searched by words or by a condition, page by page. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { get } from "../connection/requests";
import type { Page } from "../connection/schemas";
import "../parts/api-picture";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { saidOf } from "../parts/problem";
import { a } from "../words/archive";
import { degrees, t, when } from "../words/language";
import type { ArchivedSession } from "./schemas";

const COLUMNS = ["picture", "object", "captured", "cell", "lights", "solver", "sigma"] as const;
/** Pause after the last key before the archive is searched, ms. */
const PAUSE_MS = 250;

@customElement("session-list")
export class SessionList extends PageElement {
  @state() private items: ArchivedSession[] = [];
  @state() private next: string | null = null;
  @state() private failed: unknown = null;
  @state() private loading = true;
  private search = "";
  private condition = "";
  private pause = 0;

  override connectedCallback(): void {
    super.connectedCallback();
    void this.load();
  }

  private get address(): string {
    const query = new URLSearchParams({ limit: "50" });
    if (this.search) query.set("search", this.search);
    if (this.condition) query.set("where", this.condition);
    return `/archive/v1/sessions?${query.toString()}`;
  }

  private async load(address = this.address, more = false): Promise<void> {
    this.loading = true;
    try {
      const page = await get<Page<ArchivedSession>>(address);
      if (!more && address !== this.address) return; // the search has been changed meanwhile
      this.items = more ? [...this.items, ...page.items] : page.items;
      this.next = page.next;
      this.failed = null;
    } catch (error) {
      this.failed = error;
    }
    this.loading = false;
  }

  override render() {
    return html`<h1>${a("sessions")}</h1>
      <form class="search" role="search" @submit=${this.submit}>
        <label>${a("search")}<input type="search" name="search" @input=${this.type} /></label>
        <label class="wide"
          >${a("condition")}<input name="where" spellcheck="false" placeholder="sigma > 1 and solver < '0.2'" />
        </label>
        <button>${a("find")}</button>
      </form>
      ${this.failed ? saidOf(this.failed, "choice") : nothing}
      <div aria-busy=${String(this.loading)}>
        ${listTable(
          a("sessions"),
          COLUMNS.map((column) => a(column)),
          this.items.map((session) => this.row(session)),
        )}
      </div>
      ${this.items.length === 0 && !this.loading && !this.failed ? html`<p>${a("none")}</p>` : nothing}
      ${
        this.next
          ? html`<button type="button" @click=${() => void this.load(this.next!, true)}>${t("sessions.more")}</button>`
          : nothing
      }`;
  }

  private row(session: ArchivedSession) {
    return html`<tr data-session=${session.session_id}>
      <td>
        <api-picture .address=${`${session.links.picture}?width=120`} .alternative=${a("picture")}></api-picture>
      </td>
      <td><a href=${`#/${session.key}`}>${session.object || session.session_id}</a></td>
      <td>${when(session.captured)}</td>
      <td>${session.cell}</td>
      <td>${session.lights}</td>
      <td>${session.solver ?? "–"}</td>
      <td>${degrees(session.sigma_deg)}</td>
    </tr>`;
  }

  private readonly type = (event: Event): void => {
    const { form } = event.target as HTMLInputElement;
    clearTimeout(this.pause);
    this.pause = window.setTimeout(() => void this.find(form!), PAUSE_MS);
  };

  private readonly submit = (event: Event): void => {
    event.preventDefault();
    clearTimeout(this.pause);
    void this.find(event.target as HTMLFormElement);
  };

  /** Searches by both fields, so that a cleared condition no longer applies, whichever field was changed last. */
  private find(form: HTMLFormElement): Promise<void> {
    const given = new FormData(form);
    this.search = String(given.get("search") ?? "");
    this.condition = String(given.get("where") ?? "").trim();
    return this.load();
  }
}
