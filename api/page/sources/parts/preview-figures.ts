/** Figures of the present preview image. */
import { nothing } from "lit";
import { customElement } from "lit/decorators.js";
import { PageElement } from "./element";

@customElement("preview-figures")
export class PreviewFigures extends PageElement {
  override render() {
    return nothing;
  }
}
