/** Asks for the key on a service that has keys. */
import { html, nothing } from "lit";
import { customElement } from "lit/decorators.js";
import { storeKey } from "../connection/credentials";
import { live, LiveController } from "../connection/live";
import { PageElement } from "../parts/element";
import { t } from "../words/language";

@customElement("sign-in")
export class SignIn extends PageElement {
  protected readonly watching = new LiveController(this);

  override render() {
    const problem = live.keyProblem;
    return html`<form class="card narrow" @submit=${this.submit}>
      <h1>${t("sign_in.title")}</h1>
      <p>${t("sign_in.explanation")}</p>
      <label for="key">${t("sign_in.key")}</label>
      <input id="key" name="key" type="password" autocomplete="off" required spellcheck="false" />
      ${problem ? html`<p class="notice warning" role="alert">${t(`sign_in.${problem}`)}</p>` : nothing}
      <button class="primary">${t("sign_in.button")}</button>
    </form>`;
  }

  private readonly submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    storeKey(String(new FormData(event.target as HTMLFormElement).get("key") ?? "").trim());
    await live.begin();
  };
}
