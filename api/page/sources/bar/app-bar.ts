/**
 * The bar that is always in view: state of the rig, person in charge, motion of the arm, age of the connection, and
 * STOP. Below it stands the failure of an action, wherever the page is scrolled to.
 */
import { html, nothing } from "lit";
import { customElement } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { storeKey } from "../connection/credentials";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { choose, clock, duration, language, percent, t, type Word } from "../words/language";
import { sessionName, stageName } from "../words/names";
import "./safety-notice";
import "./stop-button";

/** Maximum number of characters of a session's name in the bar, which must leave the window to the screens. */
const LONGEST_NAME = 40;

function shortened(name: string): string {
  const characters = [...name];
  return characters.length > LONGEST_NAME ? `${characters.slice(0, LONGEST_NAME - 1).join("")}…` : name;
}

@customElement("app-bar")
export class AppBar extends PageElement {
  protected readonly watching = new LiveController(this, ["change", "tick"]);
  /** Keeps focused elements and headings that are jumped to from lying below the bar (`scroll-padding-top`). */
  private readonly measuring = new ResizeObserver(() =>
    document.documentElement.style.setProperty("--bar-height", `${this.offsetHeight}px`),
  );

  override connectedCallback(): void {
    super.connectedCallback();
    this.measuring.observe(this);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.measuring.disconnect();
  }

  override render() {
    const stale = live.stale;
    return html`<header class=${stale ? "bar stale" : "bar"}>
        <div class="state">
          <b id="rig-state">${this.state()}</b>
          <small id="in-charge" role="status">${this.inCharge()}</small>
        </div>
        ${live.keyNeeded ? nothing : this.arm()}
        <div class="connection" id="connection" data-stale=${String(stale)} data-open=${String(live.stream.open)}>
          <i class="dot" aria-hidden="true"></i>
          <span>${this.connection(stale)}</span>
          <small>${live.caller ? `${live.caller.name} · ${t(`role.${live.caller.role}`)}` : ""}${this.out()}</small>
        </div>
        <button
          type="button"
          class="quiet"
          lang=${language() === "en" ? "de" : "en"}
          @click=${() => choose(language() === "en" ? "de" : "en")}
        >
          ${language() === "en" ? "Deutsch" : "English"}
        </button>
        <stop-button></stop-button>
      </header>
      ${stale ? html`<p class="notice danger slim" role="alert" id="stale-notice">${this.age()}</p>` : nothing}
      ${this.failure()}
      <safety-notice></safety-notice>`;
  }

  private arm() {
    const { moving } = live;
    const word = moving === null ? "bar.arm_unknown" : moving ? "bar.arm_moves" : "bar.arm_rests";
    return html`<b id="arm-motion" class="motion" role="status" data-moving=${String(moving)}>${t(word)}</b>`;
  }

  private age(): string {
    if (live.stream.heardAt === 0) return t("bar.never_connected");
    if (live.unheard) return t("bar.stale", { time: clock(live.stream.heardAt) });
    return t("bar.rig_old", { time: clock(live.rigReadAt) });
  }

  private failure() {
    if (live.failure === null) return nothing;
    return html`<div class="failure" id="failure">
      ${saidOf(live.failure.error, "action", live.failure.name)}
      <button type="button" @click=${() => live.fail(null)}>${t("close")}</button>
    </div>`;
  }

  private inCharge(): string {
    if (live.sending.length > 0) return t("bar.sending", { name: live.sending.at(-1)! });
    return live.inCharge ? t("bar.in_charge", { name: live.inCharge }) : t("bar.nobody");
  }

  private state(): string {
    const { rig, holder } = live;
    if (!rig) return t("bar.loading");
    if (!holder) {
      if (live.moving) return t("bar.by_hand");
      if (rig.faults.length) return t("bar.stopped");
      return rig.may_start ? t("bar.free") : t("bar.not_ready");
    }
    const name = shortened(sessionName(holder));
    const words = [`${name}: ${t(`state.${holder.state}` as Word)}`];
    if (holder.state === "running") {
      words.push(stageName(holder, holder.stage), percent(holder.progress));
      if (holder.seconds_left !== null) words.push(t("bar.left", { time: duration(holder.seconds_left) }));
    }
    return words.join(" · ");
  }

  private connection(stale: boolean): string {
    if (live.stream.heardAt === 0) return t(live.keyNeeded ? "bar.signed_out" : "bar.connecting");
    if (stale) return t("bar.heard_ago", { time: duration((Date.now() - live.stream.heardAt) / 1000) });
    if (!live.stream.open) return t("bar.events_down");
    return live.stream.roundTripMs === null ? t("bar.slow") : t("bar.connected", { ms: live.stream.roundTripMs });
  }

  private out() {
    if (!live.caller || !sessionStorage.length) return nothing;
    return html` ·
      <button
        type="button"
        class="link"
        @click=${() => {
          storeKey("");
          location.reload();
        }}
      >
        ${t("bar.sign_out")}
      </button>`;
  }
}
