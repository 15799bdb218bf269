/** Base of the page's elements, drawn into the document itself, so that one style sheet and all labels apply. */
import { LitElement } from "lit";
import { onLanguage } from "../words/language";

export class PageElement extends LitElement {
  private forgetLanguage: (() => void) | null = null;

  protected override createRenderRoot(): HTMLElement {
    return this;
  }

  override connectedCallback(): void {
    super.connectedCallback();
    this.forgetLanguage = onLanguage(() => this.requestUpdate());
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.forgetLanguage?.();
  }
}
