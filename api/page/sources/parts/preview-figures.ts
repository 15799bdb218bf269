/** Figures of the present preview image: histogram, clipped shares, brightness, focus and its best since opening. */
import { html, nothing, svg } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import type { components } from "../connection/api-types";
import { get } from "../connection/requests";
import { milliseconds, number, percent, t } from "../words/language";
import { PageElement } from "./element";

type Figures = components["schemas"]["PreviewFigures"];

/** Time between two readings, ms. */
const PERIOD_MS = 500;
const WIDTH = 256;
const HEIGHT = 90;
/** Share of clipped pixels above which the figure is highlighted. */
const CLIPPED_SHARE = 0.001;

@customElement("preview-figures")
export class PreviewFigures extends PageElement {
  /** Whether clipped pixels are marked in the image. */
  @property({ type: Boolean }) clipping = false;
  @state() private figures: Figures | null = null;
  @state() private best = 0;
  private timer = 0;

  override connectedCallback(): void {
    super.connectedCallback();
    void this.read();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    clearTimeout(this.timer);
  }

  private async read(): Promise<void> {
    if (document.visibilityState === "visible") {
      try {
        this.figures = await get<Figures>("/v1/rig/preview/figures");
        this.best = Math.max(this.best, this.figures.focus ?? 0);
      } catch {
        this.figures = null; // the image beside it states the reason
      }
    }
    if (this.isConnected) this.timer = window.setTimeout(() => void this.read(), PERIOD_MS);
  }

  override render() {
    const { figures } = this;
    return html`<section class="card" aria-labelledby="figures">
      <h2 id="figures">${t("figures.title")}</h2>
      ${figures ? this.shown(figures) : html`<p role="status">${t("figures.none")}</p>`}
    </section>`;
  }

  private shown(figures: Figures) {
    const { saturated, black, bright_level: level, focus, exposure_s: exposure } = figures;
    return html`${this.histogram(figures)}
      <dl class="figures">
        <div>
          <dt>${t("figures.level")}</dt>
          <dd>${percent(level)}</dd>
        </div>
        <div>
          <dt>${t("figures.saturated")}</dt>
          <dd class=${saturated > CLIPPED_SHARE ? "warns" : ""}>${percent(saturated, 1)}</dd>
        </div>
        <div>
          <dt>${t("figures.black")}</dt>
          <dd>${percent(black, 1)}</dd>
        </div>
        ${
          exposure === null
            ? nothing
            : html`<div>
                <dt>${t("figures.exposure")}</dt>
                <dd>${milliseconds(exposure)}</dd>
              </div>`
        }
      </dl>
      <p>
        <label for="focus">${t("figures.focus")}</label> <b id="focus-score">${number(focus, 3)}</b>
        ${this.best > 0 ? t("figures.best", { best: number(this.best, 3) }) : nothing}
      </p>
      <meter id="focus" min="0" max=${this.best || 1} .value=${focus ?? 0}></meter>
      <p>
        <label
          ><input
            type="checkbox"
            id="show-clipping"
            .checked=${this.clipping}
            @change=${(event: Event) =>
              this.dispatchEvent(new CustomEvent("clipping", { detail: (event.target as HTMLInputElement).checked }))}
          />
          ${t("figures.clipping")}</label
        >
      </p>`;
  }

  /** Square roots of the counts, so that a few clipped pixels are visible beside the background. */
  private histogram({ histogram, saturated }: Figures) {
    const most = Math.sqrt(Math.max(...histogram, 1));
    const step = WIDTH / histogram.length;
    return html`<svg
      class="histogram"
      viewBox="0 0 ${WIDTH} ${HEIGHT}"
      role="img"
      aria-label=${t("figures.histogram", { share: percent(saturated, 1) })}
    >
      ${histogram.map((count, bin) => {
        const height = (HEIGHT * Math.sqrt(count)) / most;
        return svg`<rect x=${bin * step} y=${HEIGHT - height} width=${step - 0.6} height=${height}
          class=${bin === histogram.length - 1 && saturated > CLIPPED_SHARE ? "clipped" : ""}></rect>`;
      })}
    </svg>`;
  }
}
