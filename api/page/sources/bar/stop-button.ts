/**
 * STOP: halts all motion. It acts when the button goes down, not when it comes up, on Escape anywhere, and when a
 * screen reader or voice control activates it. It asks nothing, and shows within a second whether the service has
 * received it.
 */
import { html } from "lit";
import { customElement, state } from "lit/decorators.js";
import { stop, type StopState } from "../connection/stop";
import { PageElement } from "../parts/element";
import { number, t } from "../words/language";

/** Time for which the confirmation stays, ms. */
const SHOWN_MS = 20_000;

@customElement("stop-button")
export class StopButton extends PageElement {
  @state() private told: StopState = { kind: "none" };
  private timer = 0;

  private readonly key = (event: KeyboardEvent): void => {
    if (event.repeat || (event.key !== "Escape" && event.key !== "Pause")) return;
    event.preventDefault();
    this.press();
  };

  override connectedCallback(): void {
    super.connectedCallback();
    window.addEventListener("keydown", this.key, { capture: true });
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    window.removeEventListener("keydown", this.key, { capture: true });
  }

  private press(): void {
    clearTimeout(this.timer);
    stop((told) => {
      this.told = told;
      if (told.kind !== "heard") return;
      this.timer = window.setTimeout(() => (this.told = { kind: "none" }), SHOWN_MS);
    });
  }

  private pointer(event: PointerEvent): void {
    event.preventDefault();
    this.press();
  }

  private onKey(event: KeyboardEvent): void {
    if (event.repeat || (event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    this.press();
  }

  /** What helps a person to operate a browser sends a click alone, which no pointer has made (`detail` is 0). */
  private activate(event: MouseEvent): void {
    if (event.detail === 0) this.press();
  }

  /** The key has acted when it went down; coming up, it would click in some browsers. */
  private onKeyUp(event: KeyboardEvent): void {
    if (event.key === " ") event.preventDefault();
  }

  override render() {
    return html`<button
        id="stop"
        type="button"
        aria-describedby="stop-told"
        aria-keyshortcuts="Escape"
        @pointerdown=${this.pointer}
        @keydown=${this.onKey}
        @keyup=${this.onKeyUp}
        @click=${this.activate}
      >
        ${t("stop.button")}<small aria-hidden="true">Esc</small>
      </button>
      <span id="stop-told" class=${`told ${this.told.kind}`} role="alert">${this.words()}</span>`;
  }

  private words(): string {
    const told = this.told;
    if (told.kind === "sent") return t("stop.sent");
    if (told.kind === "heard") return t("stop.heard", { seconds: number(told.tookMs / 1000, 2) });
    if (told.kind === "unheard")
      return t("stop.unheard", { seconds: Math.round(told.sinceMs / 1000), attempts: told.attempts });
    return told.kind === "refused" ? t("stop.refused") : "";
  }
}
