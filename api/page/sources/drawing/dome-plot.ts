/**
 * The lights as the camera sees them, with rings at 30°, 60° and 90° from the viewing axis. A movable light is dragged,
 * or moved by the arrow keys.
 */
import { html, nothing, svg } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { PageElement } from "../parts/element";
import { number, t } from "../words/language";
import { directionOf, positionAt, type Dome } from "./dome-geometry";

const SIZE = 320;
const MIDDLE = SIZE / 2;
const RADIUS = MIDDLE - 18;
/** Angle by which an arrow key moves a light, rad. */
const STEP = (2 * Math.PI) / 180;

export interface PlottedLight {
  position: readonly number[];
  label: string;
  kind: "taken" | "planned" | "refused" | "pilot";
  /** Text added to the light's name for screen readers. */
  note?: string;
}

@customElement("dome-plot")
export class DomePlot extends PageElement {
  @property({ attribute: false }) lights: PlottedLight[] = [];
  @property({ attribute: false }) candidates: (readonly number[])[] = [];
  @property({ attribute: false }) dome: Dome | null = null;
  @property({ type: Boolean }) editable = false;
  @property({ type: Boolean }) route = false;
  @property({ type: Number }) selected = -1;
  @state() private dragged = -1;

  override render() {
    if (!this.dome) return nothing;
    const places = this.lights.map((light) => this.place(light.position));
    return html`<svg
      class="dome"
      viewBox="0 0 ${SIZE} ${SIZE}"
      role="group"
      aria-label=${t("dome.label", { count: this.lights.length })}
      @pointermove=${this.move}
      @pointerup=${this.drop}
      @pointercancel=${this.drop}
    >
      ${[30, 60, 90].map(
        (slant) => svg`<circle class="ring" cx=${MIDDLE} cy=${MIDDLE} r=${(RADIUS * slant) / 90}></circle>
          <text class="tick" x=${MIDDLE + 3} y=${MIDDLE - (RADIUS * slant) / 90 - 2}>${slant}°</text>`,
      )}
      ${this.candidates.map((one) => {
        const [x, y] = this.place(one);
        return svg`<circle class="candidate" cx=${x} cy=${y} r="1.6"></circle>`;
      })}
      ${
        this.route && places.length > 1
          ? svg`<polyline class="route" points=${places.map((place) => place.join(",")).join(" ")}></polyline>`
          : nothing
      }
      ${this.lights.map((light, index) => this.light(light, places[index]!, index))}
    </svg>`;
  }

  private light(light: PlottedLight, [x, y]: [number, number], index: number) {
    const { slant, azimuth } = directionOf(light.position, this.dome!);
    const place = t("dome.light", {
      name: light.label,
      slant: number((slant * 180) / Math.PI, 0),
      azimuth: number((azimuth * 180) / Math.PI, 0),
    });
    return svg`<g class=${`light ${light.kind}${index === this.selected ? " selected" : ""}`}
      data-light=${index}
      tabindex=${this.editable ? 0 : -1} role=${this.editable ? "button" : "img"}
      aria-label=${light.note ? `${place}, ${light.note}` : place}
      @pointerdown=${(event: PointerEvent) => this.take(event, index)}
      @focus=${() => this.choose(index)}
      @keydown=${(event: KeyboardEvent) => this.nudge(event, index)}>
      <circle cx=${x} cy=${y} r="10"></circle><text x=${x} y=${y + 4}>${light.label}</text></g>`;
  }

  private place(position: readonly number[]): [number, number] {
    const { slant, azimuth } = directionOf(position, this.dome!);
    const off = (RADIUS * slant) / (Math.PI / 2);
    return [round(MIDDLE + off * Math.cos(azimuth)), round(MIDDLE - off * Math.sin(azimuth))];
  }

  private take(event: PointerEvent, index: number): void {
    this.choose(index);
    if (!this.editable) return;
    (event.currentTarget as Element).setPointerCapture(event.pointerId);
    this.dragged = index;
  }

  private readonly move = (event: PointerEvent): void => {
    if (this.dragged < 0) return;
    const box = this.querySelector("svg")!.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * SIZE - MIDDLE;
    const y = MIDDLE - ((event.clientY - box.top) / box.height) * SIZE;
    this.put(this.dragged, (Math.hypot(x, y) / RADIUS) * (Math.PI / 2), Math.atan2(y, x));
  };

  private readonly drop = (): void => {
    if (this.dragged < 0) return;
    this.dragged = -1;
    this.dispatchEvent(new CustomEvent("light-dropped"));
  };

  private nudge(event: KeyboardEvent, index: number): void {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step || !this.editable) return;
    event.preventDefault();
    const { slant, azimuth } = directionOf(this.lights[index]!.position, this.dome!);
    const x = slant * Math.cos(azimuth) + step[0]! * STEP;
    const y = slant * Math.sin(azimuth) + step[1]! * STEP;
    this.put(index, Math.hypot(x, y), Math.atan2(y, x));
    this.dispatchEvent(new CustomEvent("light-dropped"));
  }

  private put(index: number, slant: number, azimuth: number): void {
    const position = positionAt({ slant, azimuth }, this.dome!);
    this.dispatchEvent(new CustomEvent("light-moved", { detail: { index, position } }));
  }

  private choose(index: number): void {
    this.dispatchEvent(new CustomEvent("light-chosen", { detail: index }));
  }
}

function round(value: number): number {
  return Math.round(value * 10) / 10;
}
