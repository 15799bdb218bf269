/** The present state of the cell in three dimensions, with the lights and route of the session that holds the rig. */
import { html, nothing } from "lit";
import { customElement, state } from "lit/decorators.js";
import { attempt } from "../connection/actions";
import { JournalController, live, LiveController } from "../connection/live";
import { fetchBlob } from "../connection/pictures";
import { all, get, Unreachable, UNLIMITED } from "../connection/requests";
import { scene, type Scene } from "../connection/scene";
import type { Page, Pass, PassSummary, Session } from "../connection/schemas";
import type { CellView, Layer, MarkedLight, Palette } from "../drawing/cell-view";
import { save } from "../parts/save";
import { PageElement } from "../parts/element";
import { saidOf } from "../parts/problem";
import { t, type Word } from "../words/language";

const LAYERS: Layer[] = ["labels", "candidates", "route", "bodies"];
const TURN_RAD = 0.12;

/** The view of the cell, kept for the next visit until scene or colours change. */
let kept: { view: CellView; scene: Scene; colours: Palette } | null = null;

/** Pause before a failed reading of the scene is repeated, ms. */
const RETRY_MS = 2_000;

@customElement("cell-screen")
export class CellScreen extends PageElement {
  @state() private failed: unknown = null;
  @state() private reachUnknown = false;
  @state() private computing = false;
  @state() private concealed: Layer[] = [];
  private view: CellView | null = null;
  protected readonly watching = new LiveController(this);
  private readonly scheme = matchMedia("(prefers-color-scheme: dark)");
  private readonly rebuild = (): void => void this.build();
  private readonly follow = (): void => {
    const joints = live.joints?.joints ?? live.rig?.reading?.joints;
    if (joints) this.view?.setJoints(joints);
  };
  protected readonly hearing = new JournalController(this, ({ type }) => {
    if (/^(plan|waypoints)\.ready|shot\.captured|session\.state/.test(type)) void this.mark();
  });

  override connectedCallback(): void {
    super.connectedCallback();
    live.addEventListener("joints", this.follow);
    live.addEventListener("change", this.follow);
    this.scheme.addEventListener("change", this.rebuild);
    void this.updateComplete.then(() => this.build());
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    live.removeEventListener("joints", this.follow);
    live.removeEventListener("change", this.follow);
    this.scheme.removeEventListener("change", this.rebuild);
    if (this.place) this.view?.detach(this.place);
    this.view = null;
  }

  private get place(): HTMLElement | null {
    return this.querySelector("#cell");
  }

  private async build(): Promise<void> {
    try {
      const [drawing, known] = await Promise.all([import("../drawing/cell-view"), scene()]);
      const view = await viewOf(drawing, known, palette(this));
      const { place } = this;
      if (!place || !this.isConnected) return;
      this.view = view;
      view.attach(place, (frames) => {
        if (frames === 1) {
          performance.clearMarks("cell drawn");
          performance.mark("cell drawn");
        }
        place.dataset["frames"] = String(frames);
      });
      this.reachUnknown = known.lights === null;
      this.failed = null;
      this.follow();
      await this.mark();
    } catch (error) {
      this.failed = error;
      if (error instanceof Unreachable) setTimeout(() => this.isConnected && void this.build(), RETRY_MS);
    }
  }

  /** Marks the lights of the session that holds the rig, or of the newest one. */
  private async mark(): Promise<void> {
    try {
      const newest = (await get<Page<Session>>("/v1/sessions?limit=1")).items[0];
      const id = live.rig?.holder ?? newest?.id;
      if (!id || !this.view) return;
      const summaries = await all<PassSummary>(`/v1/sessions/${id}/passes`);
      const passes = await Promise.all(summaries.map(({ number }) => get<Pass>(`/v1/sessions/${id}/passes/${number}`)));
      const lights = passes.flatMap((pass): MarkedLight[] => {
        const taken = new Set(pass.shots.map(({ shot }) => shot.light_number));
        return pass.plan.lights.map((light, index) => ({
          position: light.position,
          label: pass.plan.method === "pilot" ? `P${index + 1}` : String(index + 1),
          taken: taken.has(index),
        }));
      });
      const route = passes.at(-1)?.route;
      const way = route
        ? [route.start, ...route.waypoints.flatMap((waypoint) => waypoint.path), ...route.home_path]
        : [];
      this.view?.setLights(lights, way as unknown as number[][]);
    } catch {
      // Not reached: the bar shows that, and the next event marks them.
    }
  }

  override render() {
    return html`<h1>${t("screen.cell")}</h1>
      ${this.failed ? saidOf(this.failed, "reading") : nothing}
      <figure class="card">
        <div
          id="cell"
          class="cell"
          tabindex="0"
          role="application"
          aria-label=${t("cell.label")}
          @keydown=${this.key}
        ></div>
        <figcaption>${t("cell.how")}</figcaption>
      </figure>
      <div class="actions">
        <button type="button" @click=${() => this.view?.fit()}>${t("cell.fit")}</button>
        <button type="button" @click=${() => void this.export()}>${t("cell.export")}</button>
        ${LAYERS.map(
          (layer) =>
            html`<label
              ><input
                type="checkbox"
                .checked=${!this.concealed.includes(layer)}
                @change=${(event: Event) => this.toggle(layer, (event.target as HTMLInputElement).checked)}
              />
              ${t(`cell.${layer}` as Word)}</label
            >`,
        )}
      </div>
      <p class="legend">
        <span class="taken">${t("cell.taken")}</span> <span class="planned">${t("cell.planned")}</span>
      </p>
      ${
        this.reachUnknown
          ? html`<p class="notice">
              ${t("cell.no_reach")}
              <button type="button" ?disabled=${this.computing} @click=${() => void this.reach()}>
                ${t(this.computing ? "start.computing" : "cell.compute")}
              </button>
            </p>`
          : nothing
      }`;
  }

  private toggle(layer: Layer, shown: boolean): void {
    this.concealed = shown ? this.concealed.filter((one) => one !== layer) : [...this.concealed, layer];
    this.view?.show(layer, shown);
  }

  private readonly key = (event: KeyboardEvent): void => {
    const turns: Record<string, [number, number, number]> = {
      ArrowLeft: [-TURN_RAD, 0, 1],
      ArrowRight: [TURN_RAD, 0, 1],
      ArrowUp: [0, -TURN_RAD, 1],
      ArrowDown: [0, TURN_RAD, 1],
      "+": [0, 0, 1.15],
      "-": [0, 0, 1 / 1.15],
    };
    const turn = turns[event.key];
    if (!turn) return;
    event.preventDefault();
    this.view?.turn(...turn);
  };

  private async reach(): Promise<void> {
    this.computing = true;
    await attempt(t("cell.compute"), async () => {
      await get("/v1/rig/reach", { timeoutMs: UNLIMITED });
      await this.build();
    });
    this.computing = false;
  }

  private async export(): Promise<void> {
    const blob = await this.view?.picture();
    if (!blob) return;
    const address = URL.createObjectURL(blob);
    save(address, "cell.png");
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }
}

async function viewOf(
  drawing: typeof import("../drawing/cell-view"),
  known: Scene,
  colours: Palette,
): Promise<CellView> {
  const isSame = (one: object, other: object): boolean =>
    one === other || JSON.stringify(one) === JSON.stringify(other);
  if (!kept?.view.usable || !isSame(kept.scene, known) || !isSame(kept.colours, colours)) {
    const meshes = await meshesOf(known);
    kept?.view.close();
    kept = { view: new drawing.CellView(known, meshes, colours), scene: known, colours };
  }
  return kept.view;
}

async function meshesOf(known: Scene): Promise<Map<string, ArrayBuffer>> {
  const addresses = [
    ...known.arm.links.map((link) => link.mesh),
    ...known.bodies.flatMap((body) => (body.kind === "mesh" ? [body.mesh] : [])),
  ];
  const read = async (address: string): Promise<[string, ArrayBuffer]> => [
    address,
    await (await fetchBlob(address)).arrayBuffer(),
  ];
  return new Map(await Promise.all([...new Set(addresses)].map(read)));
}

function palette(element: Element): Palette {
  const style = getComputedStyle(element);
  const names = ["ink", "line", "arm", "accent", "warn", "good", "paper"] as const;
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()])) as Palette;
}
