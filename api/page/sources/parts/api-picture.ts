/** A picture of the API, loaded when it is near the window; says so if it is not available. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { picture } from "../connection/pictures";
import { t } from "../words/language";
import { PageElement } from "./element";

@customElement("api-picture")
export class ApiPicture extends PageElement {
  @property({ attribute: false }) address = "";
  @property({ attribute: false }) alternative = "";
  @state() private source = "";
  @state() private failed = false;
  private wanted = "";
  private near = false;
  private readonly watcher = new IntersectionObserver(
    (entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      this.near = true;
      void this.load();
    },
    { rootMargin: "300px" },
  );

  override connectedCallback(): void {
    super.connectedCallback();
    this.watcher.observe(this);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.watcher.disconnect();
  }

  override updated(): void {
    if (this.address !== this.wanted) void this.load();
  }

  private async load(): Promise<void> {
    if (!this.near || this.wanted === this.address) return;
    const address = (this.wanted = this.address);
    try {
      const source = await picture(address);
      if (address === this.wanted) this.source = source;
      this.failed = false;
    } catch {
      this.failed = true;
      setTimeout(() => {
        if (this.wanted !== address || !this.isConnected) return;
        this.wanted = "";
        void this.load();
      }, 3_000);
    }
  }

  override render() {
    if (this.source) return html`<img src=${this.source} alt=${this.alternative} decoding="async" />`;
    return html`<span class="empty-picture" role="img" aria-label=${this.alternative}
      >${this.failed ? t("picture.failed") : nothing}</span
    >`;
  }
}
