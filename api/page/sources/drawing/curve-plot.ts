/** One curve with its axes (uPlot), in the page's colours, with its values in a table for screen readers. */
import { html } from "lit";
import { customElement, property } from "lit/decorators.js";
import uPlot from "uplot";
import { PageElement } from "../parts/element";
import { number } from "../words/language";

const HEIGHT_PX = 200;

const LOGARITHMIC: uPlot.Scale = { distr: 3, range: (_plot, low, high) => [0.85 * low, 1.15 * high] };

/** Labels only the lines at 1, 2 and 5 times a power of ten. */
function ofOneTwoFive(_plot: uPlot, values: number[]): (number | null)[] {
  return values.map((value) => (/^[125]\.00e/.test(value.toExponential(2)) ? value : null));
}

/** Whether values differ: if not, a screen that is drawn again leaves the curve unchanged. */
function differ(now: readonly unknown[], before: readonly unknown[] | undefined): boolean {
  return now.length !== before?.length || now.some((value, index) => value !== before[index]);
}

@customElement("curve-plot")
export class CurvePlot extends PageElement {
  @property({ attribute: false, hasChanged: differ }) x: number[] = [];
  @property({ attribute: false, hasChanged: differ }) y: (number | null)[] = [];
  @property() xLabel = "";
  @property() yLabel = "";
  @property({ type: Boolean }) points = false;
  /** Whether the y axis is logarithmic. */
  @property({ type: Boolean }) logarithmic = false;
  private plot: uPlot | null = null;
  private readonly sizes = new ResizeObserver(() => {
    const width = this.clientWidth;
    if (width && this.plot) this.plot.setSize({ width, height: HEIGHT_PX });
  });

  override connectedCallback(): void {
    super.connectedCallback();
    this.sizes.observe(this);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.sizes.disconnect();
    this.plot?.destroy();
    this.plot = null;
  }

  override render() {
    return html`<div class="curve" role="img" aria-label=${`${this.yLabel}, ${this.xLabel}`}></div>
      ${
        this.x.length <= 100
          ? html`<div class="unseen">
              <table>
                <caption>
                  ${this.yLabel}
                </caption>
                <tbody>
                  ${this.x.map(
                    (value, index) =>
                      html`<tr>
                        <th scope="row">${number(value, 0)}</th>
                        <td>${number(this.y[index], 2)}</td>
                      </tr>`,
                  )}
                </tbody>
              </table>
            </div>`
          : ""
      }`;
  }

  override updated(): void {
    this.plot?.destroy();
    this.plot = null;
    const place = this.querySelector<HTMLElement>(".curve");
    if (!place || this.x.length === 0) return;
    const style = getComputedStyle(this);
    const ink = style.getPropertyValue("--ink-soft").trim() || "#666";
    const line = style.getPropertyValue("--accent").trim() || "#06c";
    const grid = { stroke: style.getPropertyValue("--line").trim() || "#ccc", width: 1 };
    const axis = { stroke: ink, grid, ticks: grid, font: "12px system-ui" };
    this.plot = new uPlot(
      {
        width: Math.max(this.clientWidth, 200),
        height: HEIGHT_PX,
        legend: { show: false },
        cursor: { drag: { x: false, y: false } },
        scales: { x: { time: false }, y: this.logarithmic ? LOGARITHMIC : {} },
        axes: [
          { ...axis, label: this.xLabel, labelSize: 20, size: 34 },
          {
            ...axis,
            label: this.yLabel,
            labelSize: 20,
            size: 48,
            ...(this.logarithmic ? { filter: ofOneTwoFive } : {}),
          },
        ],
        series: [{}, { stroke: line, width: 2, points: { show: this.points, size: 7 } }],
      },
      [this.x, this.y],
      place,
    );
  }
}
