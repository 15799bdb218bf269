/** The unacknowledged safety faults, with reason and remedy. The acknowledgement asks for confirmation first. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { post } from "../connection/requests";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { problemTitle, remedyOf } from "../words/problems";
import { t, when } from "../words/language";

@customElement("safety-notice")
export class SafetyNotice extends PageElement {
  @state() private asking = false;
  @state() private inspected = false;
  @state() private refused: unknown = null;
  protected readonly watching = new LiveController(this);
  private asked = "";

  /** A statement about one stop does not apply to the next. */
  override willUpdate(): void {
    const faults = (live.rig?.faults ?? []).map(({ code, since }) => `${code} ${since}`).join();
    if (faults === this.asked) return;
    this.asked = faults;
    this.asking = this.inspected = false;
    this.refused = null;
  }

  override render() {
    const faults = live.rig?.faults ?? [];
    if (faults.length === 0) return nothing;
    return html`<section class="notice danger" aria-labelledby="safety-title" role="region">
      <h2 id="safety-title">${t("safety.title")}</h2>
      <ul>
        ${faults.map(
          (fault) =>
            html`<li>
              <b>${problemTitle(fault.code)}</b> ${fault.detail}. ${remedyOf(fault.code, fault.remedy)}
              <small>${when(fault.since)}</small>
            </li>`,
        )}
      </ul>
      ${this.refused ? saidOf(this.refused) : nothing} ${live.mayOperate ? this.question() : nothing}
    </section>`;
  }

  private question() {
    if (!this.asking)
      return html`<button type="button" @click=${() => void this.ask(true)}>${t("safety.acknowledge")}</button>`;
    return html`<div class="question" role="group" aria-label=${t("safety.acknowledge")}>
      <label
        ><input
          type="checkbox"
          .checked=${this.inspected}
          @change=${(event: Event) => (this.inspected = (event.target as HTMLInputElement).checked)}
        />
        ${t("safety.question")}</label
      >
      <button type="button" class="primary" ?disabled=${!this.inspected} @click=${() => void this.acknowledge()}>
        ${t("safety.confirm")}
      </button>
      <button type="button" @click=${() => void this.ask(false)}>${t("cancel")}</button>
    </div>`;
  }

  /** Opens or closes the question. The focus moves to what replaces the button. */
  private async ask(open: boolean): Promise<void> {
    this.asking = open;
    this.inspected = false;
    await this.updateComplete;
    this.querySelector<HTMLElement>(open ? "input" : "button")?.focus();
  }

  private async acknowledge(): Promise<void> {
    try {
      await post("/v1/rig/safety/acknowledgement");
      this.refused = null;
      this.asking = this.inspected = false;
      document.querySelector("main")?.focus({ preventScroll: true });
    } catch (error) {
      this.refused = error;
    }
    live.refreshRig();
  }
}
