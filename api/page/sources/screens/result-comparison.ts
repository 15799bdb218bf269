/** Two results side by side: the same map on the same scale, their figures, and the angle between their normals. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { all } from "../connection/requests";
import type { Result, Session } from "../connection/schemas";
import { coloured, quantiles } from "../drawing/colour-scale";
import {
  MAP_NAMES,
  normalDifference,
  ResultMaps,
  SizesDiffer,
  type MapName,
  type MapPicture,
} from "../drawing/result-maps";
import { colourLegend, legendOf } from "../parts/colour-legend";
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
  /** The first map as it is drawn; its scale is used for the second too. */
  @state() private picture: MapPicture | null = null;
  /** The address of the other result, as chosen. */
  @state() private chosen = "";
  private compared = "";
  /** Number of the present drawing; late data of an earlier choice are dropped. */
  private turn = 0;

  /** Draws anew when one of the results changes. A result is not compared with itself. */
  override willUpdate(): void {
    const address = this.result.links["self"]!;
    if (address === this.compared) return;
    this.compared = address;
    if (this.chosen === address) void this.choose("");
    else if (this.other) void this.draw();
  }

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
          <option value="" ?selected=${this.chosen === ""}>${t("compare.nothing")}</option>
          ${rest.map((one) => this.option(one.links["self"]!, this.nameOf(one)))}
          ${this.sessions.map((session) => this.option(session.answer!.links["self"]!, sessionName(session)))}
        </select></label
      >
      ${this.failed ? this.failure(this.failed) : nothing} ${this.other ? this.both(this.other) : nothing}
    </section>`;
  }

  private option(address: string, name: string) {
    return html`<option value=${address} ?selected=${address === this.chosen}>${name}</option>`;
  }

  /** Names a result by its number, one of another session also by that session's name. */
  private nameOf(result: Result): string {
    const name = t("result.number", { number: result.number });
    const session = this.sessions.find((one) => one.answer!.links["self"] === result.links["self"]);
    return session ? `${sessionName(session)}, ${name}` : name;
  }

  private failure(error: unknown) {
    if (!(error instanceof SizesDiffer)) return saidOf(error, "choice");
    return html`<p class="notice warning" role="alert">
      ${t("compare.sizes", { one: error.one, other: error.other })}
    </p>`;
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
              <canvas
                data-side=${index}
                role="img"
                aria-label=${t("compare.side", { name: this.nameOf(one) })}
              ></canvas>
              ${legendOf(this.picture)}
              <figcaption>
                <b>${this.nameOf(one)}</b>: ${t("result.sigma")} ${degrees(one.summary.mean_sigma_deg)},
                ${one.summary.images} ${t("plan.images")}
              </figcaption>
            </figure>`,
        )}
        <figure>
          <canvas data-side="2" role="img" aria-label=${t("compare.angle")}></canvas>
          ${this.angles ? colourLegend("sigma_deg", 0, this.angles.high) : nothing}
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
    const turn = ++this.turn;
    this.chosen = address;
    this.other = this.failed = null;
    if (!address) return;
    try {
      const results = await all<Result>(address.replace(/\/\d+$/, ""));
      if (turn !== this.turn) return;
      this.other = results.find((one) => one.links["self"] === address) ?? null;
      await this.draw();
    } catch (error) {
      if (turn === this.turn) this.failed = error;
    }
  }

  private async draw(): Promise<void> {
    if (!this.other) return;
    const turn = ++this.turn;
    this.failed = this.angles = this.picture = null;
    this.paint([]);
    const [one, other] = [new ResultMaps(this.result), new ResultMaps(this.other)];
    try {
      const difference = await normalDifference(one, other);
      const first = await one.picture(this.map);
      const range = first.low !== null && first.high !== null ? ([first.low, first.high] as const) : undefined;
      const second = await other.picture(this.map, range);
      const inside = Uint8Array.from(difference.values, (value) => (Number.isFinite(value) ? 1 : 0));
      const [median, high] = quantiles(difference, inside, [0.5, 0.98]) as [number, number];
      const finite = difference.values.filter(Number.isFinite);
      if (turn !== this.turn) return;
      this.angles = { mean: finite.reduce((sum, value) => sum + value, 0) / Math.max(finite.length, 1), median, high };
      this.picture = first;
      await this.updateComplete;
      if (turn === this.turn) this.paint([first.image, second.image, coloured(difference, inside, 0, high)]);
    } catch (error) {
      if (turn === this.turn) this.failed = error;
    }
  }

  /** Draws the pictures side by side; missing ones are blank. */
  private paint(images: readonly ImageData[]): void {
    for (const canvas of this.querySelectorAll("canvas")) {
      const image = images[Number(canvas.dataset["side"])];
      if (!image) canvas.getContext("2d")!.clearRect(0, 0, canvas.width, canvas.height);
      else {
        [canvas.width, canvas.height] = [image.width, image.height];
        canvas.getContext("2d")!.putImageData(image, 0, 0);
      }
    }
  }
}
