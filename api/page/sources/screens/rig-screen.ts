/** The rig: what is ready and what is not, with remedies; parking; the arm's values. */
import { html, nothing } from "lit";
import { customElement } from "lit/decorators.js";
import { attemptMove } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { post } from "../connection/requests";
import type { Rig } from "../connection/schemas";
import { calibrationChecks } from "../parts/calibration-checks";
import { PageElement } from "../parts/element";
import "../parts/jog-pad";
import "../parts/key-list";
import { reasonShown, whyNoMoveByHand } from "../parts/move-reason";
import "../parts/tool-statement";
import { clock, number, t, tOr, type Word } from "../words/language";
import { problemTitle, remedyOf } from "../words/problems";

@customElement("rig-screen")
export class RigScreen extends PageElement {
  protected readonly watching = new LiveController(this, ["change", "joints"]);

  override render() {
    const rig = live.rig;
    if (!rig) return html`<p role="status">${t("loading")}</p>`;
    return html`<h1>${t("screen.rig")}: ${rig.cell}</h1>
      <section class="card" aria-labelledby="checks">
        <h2 id="checks">${t("rig.checks")}</h2>
        <ul class="checks">
          ${this.check("rig.arm", rig.connected, rig.arm ? `${rig.arm.model} · ${rig.arm.serial}` : rig.arm_address)}
          ${this.check("rig.camera", rig.camera_ready, "")} ${this.check("rig.safety", rig.faults.length === 0, "")}
          ${this.check("rig.calibration", rig.calibration.valid, "")} ${this.check("rig.free", rig.holder === null, "")}
        </ul>
        <h3>${t("check.title")}</h3>
        ${calibrationChecks(rig)}
        ${
          rig.reasons.length
            ? html`<h3>${t("rig.what_to_do")}</h3>
                <ul>
                  ${rig.reasons.map(
                    (reason) =>
                      html`<li>
                        <b>${problemTitle(reason.code)}</b> ${reason.detail}. ${remedyOf(reason.code, reason.remedy)}
                      </li>`,
                  )}
                </ul>`
            : nothing
        }
      </section>
      ${live.mayOperate ? html`${this.parkingCard()}<jog-pad></jog-pad>` : nothing}
      <section class="card" aria-labelledby="tool-title">
        <h2 id="tool-title">${t("tool.title")}</h2>
        <p>${t("tool.why")}</p>
        <tool-statement></tool-statement>
      </section>
      ${this.values(rig)} ${live.mayOperate ? html`<key-list></key-list>` : nothing} ${this.keyboard()}`;
  }

  private check(name: Word, good: boolean, more: string) {
    return html`<li class=${good ? "good" : "bad"}>
      <i aria-hidden="true">${good ? "✓" : "✕"}</i> ${t(name)}: ${t(good ? "rig.ready" : "rig.not_ready")}
      ${more ? html`<small>${more}</small>` : nothing}
    </li>`;
  }

  private parkingCard() {
    const why = whyNoMoveByHand();
    return html`<section class="card" aria-labelledby="parking">
      <h2 id="parking">${t("rig.park_title")}</h2>
      <p>${t("rig.park_why")}</p>
      <div class="actions">
        <button type="button" id="park" ?disabled=${why !== null} @click=${() => void this.park()}>
          ${t("rig.park")}
        </button>
        ${reasonShown(why)}
      </div>
      ${this.parked()}
    </section>`;
  }

  /** Outcome of the last way home of which this page has received the event. */
  private parked() {
    const last = live.events.findLast(({ type }) => type === "rig.parked");
    if (!last) return nothing;
    const outcome = String(last.body["outcome"]);
    const words = tOr(`parked.${outcome}`, outcome);
    return html`<p id="parked" role="status" class=${outcome === "at home" ? "notice good" : "notice warning"}>
      ${clock(last.at)}: ${words}
    </p>`;
  }

  private async park(): Promise<void> {
    await attemptMove(t("rig.park"), (options) => post("/v1/rig/park", undefined, options()));
  }

  private values(rig: Rig) {
    const joints = live.joints?.joints ?? rig.reading?.joints;
    if (!joints) return nothing;
    return html`<section class="card" aria-labelledby="values">
      <h2 id="values">${t("rig.values")}</h2>
      <dl class="figures">
        ${joints.map(
          (angle, index) =>
            html`<div>
              <dt>${t("rig.joint", { number: index + 1 })}</dt>
              <dd>${number((angle * 180) / Math.PI, 1)}°</dd>
            </div>`,
        )}
      </dl>
    </section>`;
  }

  private keyboard() {
    return html`<section class="card" aria-labelledby="keyboard">
      <h2 id="keyboard">${t("rig.keyboard")}</h2>
      <dl class="keys">
        <dt><kbd>Esc</kbd> <kbd>Pause</kbd></dt>
        <dd>${t("rig.key_stop")}</dd>
        <dt><kbd>Tab</kbd> <kbd>Enter</kbd></dt>
        <dd>${t("rig.key_tab")}</dd>
        <dt><kbd>←</kbd> <kbd>→</kbd> <kbd>↑</kbd> <kbd>↓</kbd></dt>
        <dd>${t("rig.key_arrows")}</dd>
      </dl>
    </section>`;
  }
}
