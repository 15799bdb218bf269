/** Two results beside each other: the same map in the same scale, their figures, and the angle between their normals. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { all } from "../connection/requests";
import type { Result, Session } from "../connection/schemas";
import { coloured, quantiles } from "../drawing/colour-scale";
import { MAP_NAMES, normalDifference, ResultMaps, type MapName } from "../drawing/result-maps";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { degrees, t, type Word } from "../words/language";
import { sessionName } from "../words/names";

@customElement("result-comparison")
export class ResultComparison extends PageElement {
  @property({ attribute: false }) result!: Result;
  @property({ attribute: false }) results: Result[] = [];
  @property({ attribute: false }) sessions: Session[] = [];
  @state() private other: Result | null = null;
  @state() private map: MapName = "sigma_deg";
  @state() private failed: unknown = null;
  @state() private angles: { mean: number; median: number; high: number } | null = null;

  override render() {
    const rest = this.results.filter((one) => one.number !== this.result.number);
    if (rest.length === 0 && this.sessions.length === 0) return nothing;
    return html`<section class="card" aria-labelledby="comparison">
      <h2 id="comparison">${t("compare.title")}</h2>
      <label class="field"
        >${t("compare.with")}
        <select
          id="compare-with"
          @change=${(event: Event) => void this.choose((event.target as HTMLSelectElement).value)}
        >
          <option value="">${t("compare.nothing")}</option>
          ${rest.map((one) => html`<option value=${one.links["self"]!}>${t("result.number", { number: one.number })}</option>`)}
          ${this.sessions.map(
            (session) => html`<option value=${session.answer!.links["self"]!}>${sessionName(session)}</option>`,
          )}
        </select></label
      >
      ${this.failed ? saidOf(this.failed) : nothing} ${this.other ? this.both(this.other) : nothing}
    </section>`;
  }

  private both(other: Result) {
    return html`<div class="tabs small" role="group" aria-label=${t("maps.title")}>
        ${MAP_NAMES.map(
          (name) =>
            html`<button
              type="button"
              aria-pressed=${String(name === this.map)}
              @click=${() => {
                this.map = name;
                void this.draw();
              }}
            >
              ${t(`map.${name}` as Word)}
            </button>`,
        )}
      </div>
      <div class="beside">
        ${[this.result, other].map(
          (one, index) =>
            html`<figure>
              <canvas data-side=${index} role="img" aria-label=${t("compare.side", { number: index + 1 })}></canvas>
              <figcaption>
                ${t("result.sigma")} ${degrees(one.summary.mean_sigma_deg)}, ${one.summary.images} ${t("plan.images")}
              </figcaption>
            </figure>`,
        )}
        <figure>
          <canvas data-side="2" role="img" aria-label=${t("compare.angle")}></canvas>
          <figcaption>
            ${t("compare.angle")}
            ${
              this.angles
                ? t("compare.angles", {
                    mean: degrees(this.angles.mean),
                    median: degrees(this.angles.median),
                    high: degrees(this.angles.high),
                  })
                : nothing
            }
          </figcaption>
        </figure>
      </div>`;
  }

  private async choose(address: string): Promise<void> {
    this.failed = this.angles = null;
    if (!address) {
      this.other = null;
      return;
    }
    try {
      const results = await all<Result>(address.replace(/\/\d+$/, ""));
      this.other = results.find((one) => one.links["self"] === address) ?? null;
      await this.draw();
    } catch (error) {
      this.failed = error;
    }
  }

  private async draw(): Promise<void> {
    if (!this.other) return;
    const [one, other] = [new ResultMaps(this.result), new ResultMaps(this.other)];
    try {
      const first = await one.picture(this.map);
      const range = first.low !== null && first.high !== null ? ([first.low, first.high] as const) : undefined;
      const second = await other.picture(this.map, range);
      const difference = await normalDifference(one, other);
      const inside = Uint8Array.from(difference.values, (value) => (Number.isFinite(value) ? 1 : 0));
      const [median, high] = quantiles(difference, inside, [0.5, 0.98]) as [number, number];
      const finite = difference.values.filter(Number.isFinite);
      this.angles = { mean: finite.reduce((sum, value) => sum + value, 0) / Math.max(finite.length, 1), median, high };
      await this.updateComplete;
      [first.image, second.image, coloured(difference, inside, 0, high)].forEach((image, side) => {
        const canvas = this.querySelector<HTMLCanvasElement>(`canvas[data-side="${side}"]`)!;
        [canvas.width, canvas.height] = [image.width, image.height];
        canvas.getContext("2d")!.putImageData(image, 0, 0);
      });
    } catch (error) {
      this.failed = error;
    }
  }
}
