/** The page: bar, navigation and the screen that the address names (`#/start`, `#/sessions/ID/result`, …). */
import { html, nothing, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import "./bar/app-bar";
import { live, LiveController } from "./connection/live";
import { PageElement } from "./parts/element";
import "./screens/calibration-screen";
import "./screens/cell-screen";
import "./screens/preview-screen";
import "./screens/queue-screen";
import "./screens/rig-screen";
import "./screens/session-screen";
import "./screens/sessions-screen";
import "./screens/sign-in";
import "./screens/start-screen";
import { t, type Word } from "./words/language";

const SCREENS = ["start", "session", "cell", "preview", "sessions", "queue", "rig", "calibration"] as const;
type Screen = (typeof SCREENS)[number];

/** A part of the address; as it is if it was mistyped, because the page has to work whatever stands there. */
function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

@customElement("operators-page")
export class OperatorsPage extends PageElement {
  @state() private way: string[] = [];
  protected readonly watching = new LiveController(this);

  private readonly turn = (): void => {
    this.way = location.hash.replace(/^#\/?/, "").split("/").filter(Boolean).map(decoded);
    live.fail(null); // an error of another screen
    this.querySelector("main")?.focus({ preventScroll: true });
    window.scrollTo(0, 0);
  };

  override connectedCallback(): void {
    super.connectedCallback();
    window.addEventListener("hashchange", this.turn);
    this.turn();
    void live.begin();
  }

  override render() {
    return html`<a class="skip" href="#main" @click=${this.skip}>${t("skip")}</a>
      <app-bar></app-bar>
      <div class="columns">
        ${live.keyNeeded ? nothing : this.navigation()}
        <main id="main" tabindex="-1">${live.keyNeeded ? html`<sign-in></sign-in>` : this.screen()}</main>
      </div>`;
  }

  private readonly skip = (event: Event): void => {
    event.preventDefault();
    this.querySelector("main")?.focus();
  };

  private get shown(): Screen {
    const [first, id] = this.way;
    if (first === "sessions" && id) return "session";
    return SCREENS.find((screen) => screen === first) ?? (live.rig?.holder ? "session" : "start");
  }

  private navigation() {
    return html`<nav aria-label=${t("navigation")}>
      ${SCREENS.map(
        (screen) =>
          html`<a href=${`#/${screen}`} aria-current=${screen === this.shown ? "page" : nothing}
            >${t(`screen.${screen}` as Word)}</a
          >`,
      )}
    </nav>`;
  }

  private screen(): TemplateResult {
    const [, id, part] = this.way;
    switch (this.shown) {
      case "session":
        return html`<session-screen
          .identity=${id ?? live.rig?.holder ?? null}
          .chapter=${part ?? ""}
        ></session-screen>`;
      case "cell":
        return html`<cell-screen></cell-screen>`;
      case "preview":
        return html`<preview-screen .identity=${id ?? null}></preview-screen>`;
      case "sessions":
        return html`<sessions-screen></sessions-screen>`;
      case "queue":
        return html`<queue-screen></queue-screen>`;
      case "rig":
        return html`<rig-screen></rig-screen>`;
      case "calibration":
        return html`<calibration-screen></calibration-screen>`;
      default:
        return html`<start-screen></start-screen>`;
    }
  }
}
