/** The archive's page: bar, sign-in, and the list or the session that the address names (`#/KEY`). */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { storedKey, storeKey } from "../connection/credentials";
import { get, Refusal } from "../connection/requests";
import type { Caller } from "../connection/schemas";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { a } from "../words/archive";
import { choose, language, t } from "../words/language";
import "./session-list";
import "./session-details";

@customElement("archive-page")
export class ArchivePage extends PageElement {
  @state() private shown = "";
  @state() private caller: Caller | null = null;
  @state() private failed: unknown = null;
  @state() private wrong = false;

  private readonly turn = (): void => {
    this.shown = location.hash.replace(/^#\/?/, "");
    this.querySelector("main")?.focus();
  };

  override connectedCallback(): void {
    super.connectedCallback();
    window.addEventListener("hashchange", this.turn);
    this.turn();
    void this.ask();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    window.removeEventListener("hashchange", this.turn);
  }

  private async ask(): Promise<void> {
    this.failed = null;
    try {
      this.caller = await get<Caller>("/v1/caller");
    } catch (error) {
      this.failed = error;
    }
  }

  private get keyNeeded(): boolean {
    return this.failed instanceof Refusal && this.failed.problem.code === "request.unauthenticated";
  }

  override render() {
    return html`<a class="skip" href="#main" @click=${this.skip}>${t("skip")}</a>
      ${this.bar()}
      <main id="main" tabindex="-1">${this.content()}</main>`;
  }

  private content() {
    if (this.keyNeeded) return this.signIn();
    if (this.failed) return saidOf(this.failed, "choice");
    if (!this.caller) return nothing;
    return this.shown
      ? html`<session-details .key=${this.shown}></session-details>`
      : html`<session-list></session-list>`;
  }

  private bar() {
    const other = language() === "en" ? "de" : "en";
    return html`<header class="bar">
      <div class="state"><b>${a("title")}</b><small>${this.caller ? this.caller.name : nothing}</small></div>
      ${storedKey() ? html`<button type="button" class="quiet" @click=${this.leave}>${t("bar.sign_out")}</button>` : nothing}
      <button type="button" class="quiet" lang=${other} @click=${() => choose(other)}>
        ${other === "de" ? "Deutsch" : "English"}
      </button>
    </header>`;
  }

  private signIn() {
    return html`<form class="card narrow" @submit=${this.submit}>
      <h1>${t("sign_in.title")}</h1>
      <p>${a("sign_in")}</p>
      <label for="key">${t("sign_in.key")}</label>
      <input id="key" name="key" type="password" autocomplete="off" required spellcheck="false" />
      ${this.wrong ? html`<p class="notice warning" role="alert">${t("sign_in.wrong")}</p>` : nothing}
      <button class="primary">${t("sign_in.button")}</button>
    </form>`;
  }

  private readonly submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    storeKey(String(new FormData(event.target as HTMLFormElement).get("key") ?? "").trim());
    await this.ask();
    this.wrong = this.keyNeeded;
    if (this.wrong) storeKey("");
  };

  private readonly leave = (): void => {
    storeKey("");
    location.reload();
  };

  private readonly skip = (event: Event): void => {
    event.preventDefault();
    this.querySelector("main")?.focus();
  };
}
