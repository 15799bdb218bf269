/** The service's keys (names, roles, age, last use), for admins, and how they are made and revoked. */
import { html, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { all } from "../connection/requests";
import type { Key } from "../connection/schemas";
import { t, type Word, when } from "../words/language";
import { PageElement } from "./element";
import { listTable } from "./list-table";
import { saidOf } from "./problem";

/** Pause before a failed reading is repeated, ms. */
const RETRY_MS = 2_000;

@customElement("key-list")
export class KeyList extends PageElement {
  @state() private keys: Key[] | null = null;
  @state() private failed: unknown = null;
  protected readonly watching = new LiveController(this);

  override connectedCallback(): void {
    super.connectedCallback();
    if (live.mayDelete) void this.load();
  }

  private async load(): Promise<void> {
    try {
      this.keys = await all<Key>("/v1/keys");
      this.failed = null;
    } catch (error) {
      this.failed = error;
      setTimeout(() => this.isConnected && void this.load(), RETRY_MS);
    }
  }

  override render() {
    return html`<section class="card" aria-labelledby="keys">
      <h2 id="keys">${t("keys.title")}</h2>
      ${this.shown()}
      <p>${t("keys.how")}</p>
      <p><code>lightpose keys add ${t("keys.name_word")} --role operator</code></p>
      <p><code>lightpose keys revoke ${t("keys.name_word")}</code></p>
    </section>`;
  }

  private shown(): TemplateResult {
    if (!live.mayDelete) return html`<p>${t("keys.for_admins")}</p>`;
    if (this.failed) return saidOf(this.failed, "reading");
    return this.keys ? this.table(this.keys) : html`<p role="status">${t("loading")}</p>`;
  }

  private table(keys: readonly Key[]) {
    const columns = [t("keys.name"), t("keys.role"), t("keys.created"), t("keys.last_used")];
    return listTable(
      t("keys.title"),
      columns,
      keys.map(
        (key) =>
          html`<tr data-key=${key.name}>
            <td>${key.name}</td>
            <td>${t(`role.${key.role}` as Word)}</td>
            <td>${when(key.created)}</td>
            <td>${key.last_used ? when(key.last_used) : t("keys.never")}</td>
          </tr>`,
      ),
    );
  }
}
