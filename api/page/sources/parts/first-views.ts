/** Where a calibration's first images will show the board, before anything moves: on request, in one drawing. */
import { html, nothing, svg } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { live, LiveController } from "../connection/live";
import { post, UNLIMITED } from "../connection/requests";
import type { PlannedViews } from "../connection/schemas";
import { t } from "../words/language";
import { PageElement } from "./element";
import { whereOf } from "./planned-view";
import { saidOf } from "./problem";

@customElement("first-views")
export class FirstViews extends PageElement {
  @property({ attribute: false }) recipe: Record<string, unknown> = {};
  @state() private planned: PlannedViews | null = null;
  @state() private failed: unknown = null;
  @state() private computing = false;
  protected readonly watching = new LiveController(this);
  /** The values for which the shown views were planned. */
  private shown = "";
  private abort = new AbortController();

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.abort.abort();
  }

  override willUpdate(): void {
    const { label: _label, notes: _notes, ...planning } = this.recipe;
    const wanted = JSON.stringify(planning);
    if (wanted === this.shown) return;
    this.shown = wanted;
    this.abort.abort();
    this.planned = this.failed = null;
    this.computing = false;
  }

  private async ask(): Promise<void> {
    const abort = (this.abort = new AbortController());
    this.computing = true;
    this.failed = null;
    try {
      const options = { signal: abort.signal, timeoutMs: UNLIMITED };
      this.planned = await post<PlannedViews>("/v1/dry-runs/views", this.recipe, options);
    } catch (error) {
      if (abort.signal.aborted) return;
      this.failed = error;
    }
    this.computing = false;
  }

  override render() {
    const { planned } = this;
    return html`${this.failed ? saidOf(this.failed, "choice") : nothing}
    ${
      planned
        ? this.picture(planned)
        : html`<button
            type="button"
            id="show-views"
            ?disabled=${this.computing || live.rig?.holder != null}
            @click=${() => void this.ask()}
          >
            ${t(this.computing ? "loading" : "views.show")}
          </button>`
    }`;
  }

  private picture({ width_px, height_px, views }: PlannedViews) {
    const seen = views.flatMap(({ number, view }) => (view ? [{ name: number + 1, view }] : []));
    const words = seen.map(({ name, view }) => `${t("view.name", { number: name })}: ${whereOf(view)}`).join("; ");
    return html`<figure>
      <svg class="view several" viewBox=${`0 0 ${width_px} ${height_px}`} role="img" aria-label=${words}>
        ${seen.map(({ name, view: { outline_px } }) => {
          const [x, y] = [0, 1].map((axis) => outline_px.reduce((sum, one) => sum + one[axis]! / 4, 0));
          return svg`<polygon points=${outline_px.map((one) => one.join(",")).join(" ")}></polygon>
            <text x=${x} y=${y} font-size=${width_px / 16}>${name}</text>`;
        })}
      </svg>
      <figcaption>${t("views.first")}</figcaption>
    </figure>`;
  }
}
