/**
 * The camera's present image, and the region of interest drawn on it.
 *
 * The image is a series of stills, each requested when the last one has been drawn. A tab in the background therefore
 * requests none, and none holds a connection that a stop may need.
 */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { attempt } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { fetchBlob } from "../connection/pictures";
import { Reading } from "../connection/reading";
import { get, Refusal, send } from "../connection/requests";
import { scene } from "../connection/scene";
import type { Page, Session } from "../connection/schemas";
import { RegionDrawing, type Point, type Tool } from "../drawing/region-drawing";
import { PageElement } from "../parts/element";
import { imageCaption, isOld } from "../parts/image-age";
import "../parts/preview-figures";
import { saidOf } from "../parts/problem";
import { readingState } from "../parts/reading-state";
import { number, t, type Word } from "../words/language";
import { sessionName } from "../words/names";

/** Minimum time between two images, ms. */
const PERIOD_MS = 200;
/** Pause after a refusal, ms. */
const RETRY_MS = 1_500;
const TOOLS: Tool[] = ["polygon", "brush", "eraser"];
const ARROWS: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

@customElement("preview-screen")
export class PreviewScreen extends PageElement {
  @property({ attribute: false }) identity: string | null = null;
  @state() private refused: unknown = null;
  @state() private tool: Tool | null = null;
  @state() private sessions: Session[] = [];
  @state() private saved: string | null = null;
  @state() private images = 0;
  @state() private clipping = false;
  private overlay: ImageBitmap | null = null;
  private drawing: RegionDrawing | null = null;
  private picture: ImageBitmap | null = null;
  private cursor: Point | null = null;
  private last: Point | null = null;
  private running = 0;
  private shownAt = 0;
  protected readonly watching = new LiveController(this, ["change", "tick"]);
  private readonly reading = new Reading(this, () => this.prepare(), { once: true });

  override connectedCallback(): void {
    super.connectedCallback();
    void this.run(++this.running);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.running += 1;
    this.picture?.close();
    this.overlay?.close();
    this.picture = this.overlay = null;
  }

  private async prepare(): Promise<true> {
    const { camera } = await scene();
    this.drawing = new RegionDrawing(camera.width_px, camera.height_px);
    const { items } = await get<Page<Session>>("/v1/sessions?limit=20");
    this.sessions = items.filter((session) => session.state === "created" || session.state === "paused");
    await this.loadRegion();
    return true;
  }

  /** Loads the region that the chosen session already has. */
  private async loadRegion(): Promise<void> {
    this.drawing?.clear();
    const id = this.chosen;
    if (!id) return;
    try {
      this.drawing?.load(await createImageBitmap(await fetchBlob(`/v1/sessions/${id}/region.png`)));
    } catch (error) {
      if (!(error instanceof Refusal && error.problem.status === 404)) throw error; // no region is drawn yet
    }
    this.paint();
  }

  private get chosen(): string | null {
    return this.sessions.find((session) => session.id === this.identity)?.id ?? this.sessions[0]?.id ?? null;
  }

  private async run(turn: number): Promise<void> {
    while (turn === this.running) {
      const start = performance.now();
      let pause = PERIOD_MS;
      if (document.visibilityState === "visible") {
        try {
          const next = await createImageBitmap(await fetchBlob("/v1/rig/preview.jpg", 10_000));
          const overlay = this.clipping
            ? await createImageBitmap(await fetchBlob("/v1/rig/preview/clipping.png", 10_000))
            : null;
          if (turn !== this.running) {
            next.close();
            overlay?.close();
            return;
          }
          this.overlay?.close();
          this.overlay = overlay;
          this.picture?.close();
          this.picture = next;
          this.refused = null;
          this.shownAt = Date.now();
          this.images += 1;
          this.paint();
        } catch (error) {
          this.refused = error;
          pause = RETRY_MS;
        }
      }
      await new Promise((resolve) => setTimeout(resolve, Math.max(20, pause - (performance.now() - start))));
    }
  }

  override render() {
    return html`<h1>${t("screen.preview")}</h1>
      ${this.refused ? saidOf(this.refused, "reading") : nothing}
      <div class="split wide-left">
        <figure class="card">
          <canvas
            id="preview"
            class=${isOld(this.shownAt) ? "old" : ""}
            data-images=${this.images}
            tabindex=${this.tool ? 0 : -1}
            role="img"
            aria-label=${imageCaption(this.shownAt)}
            @pointerdown=${this.press}
            @pointermove=${this.move}
            @pointerup=${() => (this.last = null)}
            @keydown=${this.key}
          ></canvas>
          <figcaption id="preview-age">${imageCaption(this.shownAt)}</figcaption>
        </figure>
        <div>
          <preview-figures
            .clipping=${this.clipping}
            @clipping=${(event: CustomEvent<boolean>) => (this.clipping = event.detail)}
          ></preview-figures>
          ${live.mayOperate ? this.region() : nothing}
        </div>
      </div>`;
  }

  private region() {
    return html`<section class="card" aria-labelledby="region">
      <h2 id="region">${t("region.title")}</h2>
      <p>${t("region.why")}</p>
      ${
        this.sessions.length === 0
          ? html`${readingState(this.reading)} ${this.reading.found ? this.noSession() : nothing}`
          : html`<label class="field"
                >${t("session")}
                <select
                  @change=${(event: Event) => {
                    this.identity = (event.target as HTMLSelectElement).value;
                    void this.loadRegion();
                  }}
                >
                  ${this.sessions.map(
                    (session) =>
                      html`<option value=${session.id} ?selected=${session.id === this.chosen}>
                        ${sessionName(session)}
                      </option>`,
                  )}
                </select></label
              >
              <div class="actions" role="group" aria-label=${t("region.tools")}>
                ${TOOLS.map(
                  (tool) =>
                    html`<button
                      type="button"
                      data-tool=${tool}
                      aria-pressed=${String(tool === this.tool)}
                      @click=${() => this.choose(tool)}
                    >
                      ${t(`region.${tool}` as Word)}
                    </button>`,
                )}
              </div>
              ${this.tool === "polygon" ? html`<p>${t("region.polygon_how")}</p>` : nothing}
              <div class="actions">
                <button type="button" ?disabled=${this.tool !== "polygon"} @click=${() => this.close()}>
                  ${t("region.close")}
                </button>
                <button type="button" @click=${() => this.clear()}>${t("region.clear")}</button>
                <button type="button" class="primary" id="save-region" @click=${() => void this.save()}>
                  ${t("region.save")}
                </button>
              </div>
              ${this.saved ? html`<p class="notice good" role="status">${this.saved}</p>` : nothing}`
      }
    </section>`;
  }

  private noSession() {
    return html`<p class="notice">${t("region.no_session")} <a href="#/start">${t("screen.start")}</a></p>`;
  }

  private choose(tool: Tool): void {
    this.tool = this.tool === tool ? null : tool;
    this.cursor = null;
    this.paint();
  }

  private close(): void {
    this.drawing?.closePolygon();
    this.paint();
  }

  private clear(): void {
    this.drawing?.clear();
    this.paint();
  }

  private place(event: PointerEvent): Point {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const { width, height } = this.drawing!;
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  }

  private readonly press = (event: PointerEvent): void => {
    if (!this.tool || !this.drawing) return;
    const point = this.place(event);
    if (this.tool === "polygon") this.drawing.corners = [...this.drawing.corners, point];
    else {
      (event.currentTarget as Element).setPointerCapture(event.pointerId);
      this.drawing.stroke(point, point, this.tool);
      this.last = point;
    }
    this.paint();
  };

  private readonly move = (event: PointerEvent): void => {
    if (!this.tool || !this.drawing) return;
    this.cursor = this.place(event);
    if (this.last && this.tool !== "polygon") {
      this.drawing.stroke(this.last, this.cursor, this.tool);
      this.last = this.cursor;
    }
    this.paint();
  };

  /** Draws the polygon without a mouse: arrow keys move a cross, Enter sets a corner, C closes. */
  private readonly key = (event: KeyboardEvent): void => {
    const drawing = this.drawing;
    if (this.tool !== "polygon" || !drawing) return;
    const arrow = ARROWS[event.key];
    const [x, y] = this.cursor ?? [drawing.width / 2, drawing.height / 2];
    const step = drawing.width * (event.shiftKey ? 0.05 : 0.01);
    if (arrow) this.cursor = [x + arrow[0] * step, y + arrow[1] * step];
    else if (event.key === "Enter") drawing.corners = [...drawing.corners, [x, y]];
    else if (event.key === "c") drawing.closePolygon();
    else return;
    event.preventDefault();
    this.paint();
  };

  private paint(): void {
    const canvas = this.querySelector<HTMLCanvasElement>("#preview");
    if (!canvas || !this.picture) return;
    const { width, height } = this.picture;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const ink = canvas.getContext("2d")!;
    ink.drawImage(this.picture, 0, 0);
    if (this.overlay) {
      ink.imageSmoothingEnabled = false;
      ink.drawImage(this.overlay, 0, 0, width, height);
    }
    const colour = getComputedStyle(this).getPropertyValue("--accent") || "#2a7";
    this.drawing?.show(ink, width / this.drawing.width, colour, this.tool === "polygon" ? this.cursor : null);
  }

  private async save(): Promise<void> {
    if (!this.drawing || !this.chosen) return;
    this.drawing.closePolygon();
    this.paint();
    const { chosen, drawing } = this;
    await attempt(t("region.save"), async () => {
      const answer = await send("PUT", `/v1/sessions/${chosen}/region.png`, { body: await drawing.png() });
      const { pixels } = (await answer.json()) as { pixels: number };
      this.saved = t("region.saved", { pixels: number(pixels, 0) });
    });
  }
}
