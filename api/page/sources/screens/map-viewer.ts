/** One result's maps: choose one, read values, draw a profile line in mm, or move a light over the surface. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { scene, type Scene } from "../connection/scene";
import { grey, quantiles } from "../drawing/colour-scale";
import "../drawing/curve-plot";
import { profileOf, type Profile } from "../drawing/height-profile";
import type { Point } from "../drawing/region-drawing";
import { Relighting, type Surface } from "../drawing/relighting";
import { MAP_NAMES, mapValue, ResultMaps, type MapName, type MapPicture, type MapSource } from "../drawing/result-maps";
import { legendOf } from "../parts/colour-legend";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { save } from "../parts/save";
import { number, t, type Word } from "../words/language";

type Shown = MapName | "relit";

const SURFACES: Surface[] = ["own", "clay", "gloss"];
/** Sine of the largest slant of the movable light. */
const MOST = Math.sin((85 * Math.PI) / 180);
const LIGHT_STEP = 0.08;
@customElement("map-viewer")
export class MapViewer extends PageElement {
  @property({ attribute: false }) result!: MapSource;
  /** The camera of the images; by default the rig's. */
  @property({ attribute: false }) camera: () => Promise<Scene["camera"]> = async () => (await scene()).camera;
  @state() private shown: Shown = "normals";
  @state() private picture: MapPicture | null = null;
  @state() private failed: unknown = null;
  @state() private surface: Surface = "own";
  @state() private light: [number, number, number] = [-0.5, 0.5, Math.SQRT1_2];
  @state() private value = "";
  @state() private line: [Point, Point] | null = null;
  @state() private profile: Profile | null = null;
  @state() private loading = false;
  private maps: ResultMaps | null = null;
  private relighting: Relighting | null = null;
  private begun: Point | null = null;

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.relighting?.close();
    this.relighting = null;
  }

  override willUpdate(): void {
    if (this.maps?.result.links["self"] === this.result.links["self"]) return;
    this.maps = new ResultMaps(this.result);
    this.line = this.profile = null;
    void this.show(this.shown);
  }

  private async show(name: Shown): Promise<void> {
    const maps = this.maps!;
    const isWanted = (): boolean => this.shown === name && maps === this.maps;
    this.shown = name;
    // Until the new map is read, nothing of another map or result is shown under its name.
    this.picture = this.failed = null;
    this.value = "";
    this.relighting?.close();
    this.relighting = null;
    this.loading = true;
    try {
      if (name === "relit") await this.relight(maps);
      else {
        const picture = await maps.picture(name);
        if (isWanted()) this.picture = picture;
      }
    } catch (error) {
      if (isWanted()) this.failed = error;
    }
    if (isWanted()) this.loading = false;
    this.requestUpdate();
    await this.updateComplete;
    this.paint();
  }

  private async relight(maps: ResultMaps): Promise<void> {
    const [normals, albedo, inside] = await Promise.all([maps.normals(), maps.drawn("albedo"), maps.inside()]);
    await this.updateComplete;
    const canvas = this.querySelector<HTMLCanvasElement>("#relit");
    if (!canvas || this.shown !== "relit" || maps !== this.maps) return;
    this.relighting?.close();
    const [white] = quantiles(albedo, inside, [0.995]) as [number];
    const copy = new OffscreenCanvas(normals.width, normals.height);
    copy.getContext("2d")!.putImageData(normals, 0, 0);
    [canvas.width, canvas.height] = [normals.width, normals.height];
    this.relighting = new Relighting(canvas, copy, grey(albedo, inside, white));
  }

  override render() {
    return html`<section class="card" aria-labelledby="maps">
      <h2 id="maps">${t("maps.title")}</h2>
      <div class="tabs small" role="group" aria-label=${t("maps.title")}>
        ${[...MAP_NAMES, "relit" as const].map(
          (name) =>
            html`<button
              type="button"
              data-map=${name}
              aria-pressed=${String(name === this.shown)}
              @click=${() => void this.show(name)}
            >
              ${t(`map.${name}` as Word)}
            </button>`,
        )}
      </div>
      ${this.failed ? saidOf(this.failed, "choice") : nothing}
      <div class="split wide-left">
        <figure aria-busy=${String(this.loading)} class="over">
          ${this.loading ? html`<p role="status">${t("loading")}</p>` : nothing}
          ${this.shown === "relit" ? this.lamp() : this.map()}
          <figcaption>${t(`map.${this.shown}.means` as Word)}</figcaption>
        </figure>
        <div>${this.shown === "relit" ? this.surfaces() : this.reading()}</div>
      </div>
    </section>`;
  }

  private map() {
    return html`<canvas
      id="map"
      tabindex="-1"
      role="img"
      aria-label=${t(`map.${this.shown}` as Word)}
      @pointerdown=${this.press}
      @pointermove=${this.hover}
      @pointerup=${() => (this.begun = null)}
    ></canvas>`;
  }

  private lamp() {
    return html`<canvas
      id="relit"
      tabindex="0"
      role="application"
      aria-label=${t("maps.move_light")}
      @pointerdown=${(event: PointerEvent) => {
        (event.currentTarget as Element).setPointerCapture(event.pointerId);
        this.aimAt(event);
      }}
      @pointermove=${(event: PointerEvent) => event.buttons && this.aimAt(event)}
      @keydown=${this.key}
    ></canvas>`;
  }

  private surfaces() {
    const [x, y, z] = this.light;
    return html`<p>${t("maps.move_light")}</p>
      <label class="field"
        >${t("maps.surface")}
        <select
          @change=${(event: Event) => {
            this.surface = (event.target as HTMLSelectElement).value as Surface;
          }}
        >
          ${SURFACES.map((one) => html`<option value=${one}>${t(`surface.${one}` as Word)}</option>`)}
        </select></label
      >
      <p>
        ${t("maps.light_at", {
          slant: number((Math.acos(z) * 180) / Math.PI, 0),
          azimuth: number((Math.atan2(y, x) * 180) / Math.PI, 0),
        })}
      </p>`;
  }

  private reading() {
    return html`${legendOf(this.picture)}
      <p role="status">${this.value || t("maps.hover")}</p>
      <button type="button" class="link" @click=${this.export}>${t("maps.save")}</button>
      ${
        this.profile
          ? html`<h3>${t("maps.profile")}</h3>
              <curve-plot
                .x=${this.profile.along}
                .y=${this.profile.height}
                .xLabel=${t("maps.along")}
                .yLabel=${t("maps.height")}
              ></curve-plot>`
          : nothing
      }`;
  }

  override updated(): void {
    this.paint();
  }

  private paint(): void {
    if (this.shown === "relit") {
      this.relighting?.draw(this.light, this.surface);
      return;
    }
    const canvas = this.querySelector<HTMLCanvasElement>("#map");
    if (!canvas) return;
    if (!this.picture) {
      canvas.getContext("2d")!.clearRect(0, 0, canvas.width, canvas.height);
      return;
    }
    const { image } = this.picture;
    if (canvas.width !== image.width || canvas.height !== image.height)
      [canvas.width, canvas.height] = [image.width, image.height];
    const ink = canvas.getContext("2d")!;
    ink.putImageData(image, 0, 0);
    if (!this.line) return;
    ink.strokeStyle = "#f33";
    ink.lineWidth = Math.max(1.5, image.width / 300);
    ink.beginPath();
    ink.moveTo(...this.line[0]);
    ink.lineTo(...this.line[1]);
    ink.stroke();
  }

  private pixel(event: PointerEvent): Point {
    const canvas = event.currentTarget as HTMLCanvasElement;
    const box = canvas.getBoundingClientRect();
    return [
      Math.floor(((event.clientX - box.left) / box.width) * canvas.width),
      Math.floor(((event.clientY - box.top) / box.height) * canvas.height),
    ];
  }

  private readonly press = (event: PointerEvent): void => {
    (event.currentTarget as Element).setPointerCapture(event.pointerId);
    this.begun = this.pixel(event);
  };

  private readonly hover = (event: PointerEvent): void => {
    if (!this.picture) return;
    const at = this.pixel(event);
    if (this.begun && event.buttons) {
      this.line = [this.begun, at];
      void this.tell(this.draw(this.picture));
    }
    void this.tell(this.read(this.picture, at));
  };

  /** Shows the error if a reading for the displayed picture fails. */
  private async tell(reading: Promise<void>): Promise<void> {
    const { picture } = this;
    try {
      await reading;
    } catch (error) {
      if (picture === this.picture) this.failed = error;
    }
  }

  private async read(picture: MapPicture, [u, v]: Point): Promise<void> {
    const { u: x, v: y, values } = await this.valuesAt(picture, u, v);
    if (picture !== this.picture) return;
    const written = values.map((value) => mapValue(picture.name, value)).join(", ");
    this.value = t("maps.value", { u: x, v: y, value: written });
  }

  /** Values of a pixel of the drawn map: normals from their picture, the others from the full map. */
  private async valuesAt(
    { name, image: drawn }: MapPicture,
    u: number,
    v: number,
  ): Promise<{ u: number; v: number; values: number[] }> {
    if (name === "normals") {
      const colour = drawn.data.subarray(4 * (v * drawn.width + u), 4 * (v * drawn.width + u) + 3);
      return { u, v, values: Array.from(colour, (part) => part / 127.5 - 1) };
    }
    const map = await this.maps!.values(name);
    const [x, y] = [u, v].map((place) => Math.floor((place * map.width) / drawn.width)) as [number, number];
    return { u: x, v: y, values: [map.values[y * map.width + x] ?? NaN] };
  }

  private async draw(picture: MapPicture): Promise<void> {
    const [line, maps] = [this.line, this.maps!];
    if (!line) return;
    const [depth, camera] = await Promise.all([maps.values("depth"), this.camera()]);
    if (line !== this.line) return;
    const scale = depth.width / picture.image.width;
    const scaled = ([u, v]: Point): Point => [Math.round(u * scale), Math.round(v * scale)];
    const profile = profileOf(depth, scaled(line[0]), scaled(line[1]), camera);
    this.profile = profile.along.length > 1 ? profile : null;
  }

  private readonly key = (event: KeyboardEvent): void => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step) return;
    event.preventDefault();
    this.aim(this.light[0] + step[0]! * LIGHT_STEP, this.light[1] + step[1]! * LIGHT_STEP);
  };

  private aimAt(event: PointerEvent): void {
    const box = (event.currentTarget as Element).getBoundingClientRect();
    this.aim((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
  }

  private aim(x: number, y: number): void {
    const r = Math.hypot(x, y);
    const k = r > MOST ? MOST / r : 1;
    this.light = [x * k, y * k, Math.sqrt(1 - k * k * r * r)];
  }

  private readonly export = (): void => {
    this.querySelector<HTMLCanvasElement>("#map")?.toBlob((blob) => {
      if (!blob) return;
      const address = URL.createObjectURL(blob);
      save(address, `${this.shown}.png`);
      setTimeout(() => URL.revokeObjectURL(address), 10_000);
    });
  };
}
