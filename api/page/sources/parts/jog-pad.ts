/** Buttons that move the arm while they are held, by pointer or by key. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { Jogging, type JogMotion } from "../connection/jogging";
import { LiveController } from "../connection/live";
import { t } from "../words/language";
import { PageElement } from "./element";
import { reasonShown, whyNoMoveByHand } from "./move-reason";
import { saidOf } from "./problem";

const AXES = ["x", "y", "z"] as const;
const JOINTS = [0, 1, 2, 3, 4, 5] as const;

@customElement("jog-pad")
export class JogPad extends PageElement {
  @state() private refused: unknown = null;
  @state() private held: string | null = null;
  protected readonly watching = new LiveController(this);
  private readonly jogging = new Jogging((error) => {
    this.refused = error;
    this.held = null;
  });
  private readonly release = (): void => {
    this.jogging.release();
    this.held = null;
  };

  override connectedCallback(): void {
    super.connectedCallback();
    // The motion ends wherever the pointer is: outside the button, in another window, in another tab.
    for (const type of ["pointerup", "pointercancel", "blur", "pagehide"]) window.addEventListener(type, this.release);
    document.addEventListener("visibilitychange", this.release);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.release();
    for (const type of ["pointerup", "pointercancel", "blur", "pagehide"])
      window.removeEventListener(type, this.release);
    document.removeEventListener("visibilitychange", this.release);
  }

  override render() {
    return html`<section class="card" aria-labelledby="jog">
      <h2 id="jog">${t("jog.title")}</h2>
      <p>${t("jog.why")}</p>
      ${reasonShown(whyNoMoveByHand())}
      <h3>${t("jog.tool")}</h3>
      <div class="jog">${AXES.map((axis) => this.pair(t(`jog.${axis}`), { axis }))}</div>
      <h3>${t("jog.joints")}</h3>
      <div class="jog">${JOINTS.map((joint) => this.pair(t("rig.joint", { number: joint + 1 }), { joint }))}</div>
      ${
        // Below the buttons, because text above would shift them, and the next press would hit another joint's button.
        this.refused ? saidOf(this.refused) : nothing
      }
    </section>`;
  }

  private pair(name: string, what: { axis: "x" | "y" | "z" } | { joint: number }) {
    return html`<div role="group" aria-label=${name}>
      <span>${name}</span>${this.button(name, { ...what, direction: -1 })}
      ${this.button(name, { ...what, direction: 1 })}
    </div>`;
  }

  private button(name: string, motion: JogMotion) {
    const sign = motion.direction > 0 ? "+" : "−";
    const id = `${name} ${sign}`;
    const press = (event: Event): void => {
      event.preventDefault();
      this.refused = null;
      this.held = id;
      this.jogging.press(motion);
    };
    const isHold = (event: KeyboardEvent): boolean => event.key === " " || event.key === "Enter";
    return html`<button
      type="button"
      aria-label=${id}
      aria-pressed=${String(this.held === id)}
      ?disabled=${whyNoMoveByHand() !== null}
      @pointerdown=${(event: PointerEvent) => event.button === 0 && press(event)}
      @keydown=${(event: KeyboardEvent) => isHold(event) && !event.repeat && press(event)}
      @keyup=${(event: KeyboardEvent) => isHold(event) && this.release()}
      @blur=${this.release}
      @contextmenu=${(event: Event) => event.preventDefault()}
    >
      ${sign}
    </button>`;
  }
}
