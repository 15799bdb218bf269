/** The camera's live image with the detected corners of the calibration board, and a sentence on whether it is seen. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { LiveController } from "../connection/live";
import { fetchBlob } from "../connection/pictures";
import { get } from "../connection/requests";
import type { TargetView } from "../connection/schemas";
import { t } from "../words/language";
import { PageElement } from "./element";
import { imageCaption, isOld } from "./image-age";
import { saidOf } from "./problem";

/** Minimum time between two images, ms; the board is detected in each. */
const PERIOD_MS = 400;
/** Pause after a refusal, ms. */
const RETRY_MS = 1_500;

@customElement("target-preview")
export class TargetPreview extends PageElement {
  /** Whether the calibration board is detected. */
  @property({ attribute: false }) board = true;
  @state() private found: TargetView | null = null;
  @state() private refused: unknown = null;
  private running = 0;
  private shownAt = 0;
  protected readonly watching = new LiveController(this, ["change", "tick"]);

  override connectedCallback(): void {
    super.connectedCallback();
    void this.run(++this.running);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.running += 1;
  }

  private async run(turn: number): Promise<void> {
    while (turn === this.running) {
      let pause = PERIOD_MS;
      if (document.visibilityState === "visible") {
        try {
          const picture = await createImageBitmap(await fetchBlob("/v1/rig/preview.jpg", 10_000));
          const found = this.board ? await get<TargetView>("/v1/rig/preview/target") : null;
          if (turn === this.running) this.paint(picture, found);
          picture.close();
          this.found = found;
          this.refused = null;
          this.shownAt = Date.now();
        } catch (error) {
          this.refused = error;
          this.found = null; // what an old image shows says nothing about now
          pause = RETRY_MS;
        }
      }
      await new Promise((resolve) => setTimeout(resolve, pause));
    }
  }

  private paint(picture: ImageBitmap, found: TargetView | null): void {
    const canvas = this.querySelector("canvas")!;
    [canvas.width, canvas.height] = [picture.width, picture.height];
    const ink = canvas.getContext("2d")!;
    ink.drawImage(picture, 0, 0);
    if (!found) return;
    const scale = picture.width / found.width_px;
    const radius = Math.max(3, picture.width / 130);
    for (const [colour, thickness] of [
      ["#000", radius],
      ["#4ef08a", radius / 2],
    ] as const) {
      [ink.strokeStyle, ink.lineWidth] = [colour, thickness];
      for (const [column, row] of found.corners_px) {
        ink.beginPath();
        ink.arc(column! * scale, row! * scale, radius, 0, 2 * Math.PI);
        ink.stroke();
      }
    }
  }

  override render() {
    const label = imageCaption(this.shownAt);
    const old = isOld(this.shownAt) ? " old" : "";
    return html`<figure>
        <canvas role="img" class=${`picture${old}`} aria-label=${label}></canvas>
        <figcaption>${label}</figcaption>
      </figure>
      ${this.refused ? saidOf(this.refused, "reading") : nothing} ${this.board ? this.words() : nothing}`;
  }

  private words() {
    const { found } = this;
    const words = !found
      ? t("loading")
      : found.seen
        ? t("target.found", { found: found.corners_px.length, all: found.corners })
        : `${t("target.missing")} ${found.why_not}`;
    return html`<p
      id="target-found"
      role="status"
      data-seen=${found ? String(found.seen) : nothing}
      class=${found?.seen ? "notice good" : "notice"}
    >
      ${words}
    </p>`;
  }
}
