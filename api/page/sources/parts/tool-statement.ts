/** A person's statement of what is on the flange. The service certifies paths for it, and cannot see it. */
import { html, nothing } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { attempt } from "../connection/actions";
import { live, LiveController } from "../connection/live";
import { send } from "../connection/requests";
import type { Rig } from "../connection/schemas";
import { t } from "../words/language";
import { PageElement } from "./element";

type Tool = Rig["tool"];
const TOOLS: Tool[] = ["lamp", "board"];

@customElement("tool-statement")
export class ToolStatement extends PageElement {
  /** The tool that is needed on the flange next; null: any. */
  @property({ attribute: false }) needed: Tool | null = null;
  @state() private asked: Tool | null = null;
  protected readonly watching = new LiveController(this);

  override render() {
    const stated = live.rig?.tool;
    if (!stated) return nothing;
    const ready = this.needed === null || this.needed === stated;
    return html`<p id="tool" data-tool=${stated} class=${ready ? "notice good" : "notice warning"}>
        ${t("tool.stated", { tool: t(`tool.${stated}`) })}
        ${ready ? nothing : t("tool.mount", { tool: t(`tool.${this.needed!}`) })}
      </p>
      ${live.mayOperate ? this.choice(stated) : nothing}`;
  }

  private choice(stated: Tool) {
    if (this.asked)
      return html`<div class="question" role="group" aria-label=${t("tool.title")}>
        <p>${t("tool.ask", { tool: t(`tool.${this.asked}`) })}</p>
        <button type="button" class="primary" id="state-tool" @click=${() => void this.put(this.asked!)}>
          ${t("tool.yes")}
        </button>
        <button type="button" @click=${() => (this.asked = null)}>${t("cancel")}</button>
      </div>`;
    return html`<div class="actions">
      ${TOOLS.filter((tool) => tool !== stated).map(
        (tool) =>
          html`<button
            type="button"
            class=${tool === this.needed ? "primary" : ""}
            data-tool=${tool}
            ?disabled=${live.rig?.holder != null}
            @click=${() => (this.asked = tool)}
          >
            ${t("tool.state", { tool: t(`tool.${tool}`) })}
          </button>`,
      )}
    </div>`;
  }

  private async put(tool: Tool): Promise<void> {
    this.asked = null;
    const name = t("tool.state", { tool: t(`tool.${tool}`) });
    await attempt(name, () => send("PUT", "/v1/rig/tool", { body: { tool } }));
    live.refreshRig();
  }
}
