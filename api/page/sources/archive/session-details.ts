/** One session: facts, results and the changes between them, maps, movable light, exports. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { get, openable } from "../connection/requests";
import type { Scene } from "../connection/scene";
import { PageElement } from "../parts/element";
import { listTable } from "../parts/list-table";
import { saidOf } from "../parts/problem";
import { save } from "../parts/save";
import "../screens/map-viewer";
import { a, type ArchiveWord } from "../words/archive";
import { degrees, number, when } from "../words/language";
import type { ArchivedResult, ArchivedSessionDetails } from "./schemas";

const FORMS = ["bagit", "relight", "folder"] as const;
const COLUMNS = ["shown", "solver", "settings", "images", "origin", "solved", "sigma", "moved", "over_sigma"] as const;

@customElement("session-details")
export class SessionDetails extends PageElement {
  @property({ attribute: false }) key = "";
  @state() private session: ArchivedSessionDetails | null = null;
  @state() private chosen: ArchivedResult | null = null;
  @state() private failed: unknown = null;

  override willUpdate(changed: Map<string, unknown>): void {
    if (changed.has("key")) void this.load(this.key);
  }

  private async load(key: string): Promise<void> {
    this.session = this.chosen = this.failed = null;
    try {
      const session = await get<ArchivedSessionDetails>(`/archive/v1/sessions/${key}`);
      if (key !== this.key) return;
      this.session = session;
      this.chosen = session.results.filter((result) => result.state === "done").at(-1) ?? null;
    } catch (error) {
      this.failed = error;
    }
  }

  override render() {
    const { session } = this;
    return html`<p><a href="#/">${a("back")}</a></p>
      ${this.failed ? saidOf(this.failed, "choice") : nothing}
      ${session ? html`${this.head(session)} ${this.results(session)} ${this.maps()} ${this.files(session)}` : nothing}`;
  }

  private head(session: ArchivedSessionDetails) {
    const facts: [ArchiveWord, string][] = [
      ["captured", when(session.captured)],
      ["cell", session.cell],
      ["lights", String(session.lights)],
      ["sigma", degrees(session.sigma_deg)],
      ["size", `${session.width} × ${session.height} px, ${number(session.bytes / 1e6, 1)} MB`],
      ["software", session.software],
    ];
    return html`<div class="title">
        <h1>${session.object || session.session_id}</h1>
        <small>${session.session_id}</small>
      </div>
      ${session.notes ? html`<p>${session.notes}</p>` : nothing}
      <dl class="figures">
        ${facts.map(
          ([name, value]) =>
            html`<div>
              <dt>${a(name)}</dt>
              <dd class="words">${value}</dd>
            </div>`,
        )}
      </dl>
      <div class="actions" role="group" aria-label=${a("download")}>
        ${FORMS.map(
          (form) =>
            html`<button type="button" data-form=${form} @click=${() => void this.download(session, form)}>
              ${a(`form.${form}`)}
            </button>`,
        )}
      </div>`;
  }

  private results(session: ArchivedSessionDetails) {
    if (session.results.length === 0) return html`<p>${a("no_result")}</p>`;
    return html`<h2>${a("results")}</h2>
      ${listTable(
        a("results"),
        COLUMNS.map((column) => a(column)),
        session.results.map((result) => this.row(result)),
      )}
      <p class="caption">${a("moved.means")}</p>`;
  }

  private row(result: ArchivedResult) {
    const name = `${result.solver} ${result.settings}`;
    const images = result.last_pass === null ? a("all_images") : a("to_pass", { number: result.last_pass + 1 });
    return html`<tr>
      <td>
        ${
          result.state === "done"
            ? html`<input
                type="radio"
                name="shown"
                aria-label=${name}
                .checked=${result === this.chosen}
                @change=${() => (this.chosen = result)}
              />`
            : html`<span class="badge">${a(`state.${result.state}`)}</span>`
        }
      </td>
      <td>${result.solver}</td>
      <td><code>${result.settings.slice(0, 8)}</code></td>
      <td>${images}</td>
      <td>${a(`origin.${result.origin}`)}</td>
      <td>${when(result.solved)}</td>
      <td>${degrees(result.sigma_deg)}</td>
      <td>${degrees(result.moved_mean_deg, 3)}</td>
      <td>${result.error ?? number(result.moved_over_sigma)}</td>
    </tr>`;
  }

  private maps() {
    if (!this.chosen) return nothing;
    return html`<map-viewer .result=${this.chosen} .camera=${this.camera}></map-viewer>`;
  }

  private files(session: ArchivedSessionDetails) {
    const files = [...session.files, ...session.results.flatMap((result) => result.files)];
    return html`<details>
      <summary>${a("files", { number: files.length })}</summary>
      <ul>
        ${files.map(
          ({ path }) =>
            html`<li>
              <button
                type="button"
                class="link"
                @click=${() => void this.fetch(`${session.links.self}/files/${path}`, path.split("/").at(-1)!)}
              >
                ${path}
              </button>
            </li>`,
        )}
      </ul>
    </details>`;
  }

  /** The camera that captured the session, from its calibration. */
  private readonly camera = async (): Promise<Scene["camera"]> => {
    const read = await get<{ camera_matrix: Scene["camera"]["camera_matrix"]; width: number; height: number }>(
      `${this.session!.links.self}/files/calibration.json`,
    );
    return { camera_matrix: read.camera_matrix, width_px: read.width, height_px: read.height } as Scene["camera"];
  };

  private download(session: ArchivedSessionDetails, form: (typeof FORMS)[number]): Promise<void> {
    return this.fetch(`${session.links.export}?form=${form}`, `${session.session_id}-${form}.zip`);
  }

  private async fetch(address: string, name: string): Promise<void> {
    try {
      save(await openable(address), name);
    } catch (error) {
      this.failed = error;
    }
  }
}
