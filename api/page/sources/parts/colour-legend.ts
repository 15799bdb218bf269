/** The colour scale of a map with its ends, which lie within the range of values: a fiftieth of them is cut off. */
import { html, nothing } from "lit";
import { mapValue, type MapName, type MapPicture } from "../drawing/result-maps";

export function colourLegend(name: MapName, low: number, high: number) {
  return html`<p class="scale">
    <span>${low > 0 ? "≤ " : ""}${mapValue(name, low)}</span><i class="viridis" aria-hidden="true"></i
    ><span>≥ ${mapValue(name, high)}</span>
  </p>`;
}

/** The legend of a map in the colour scale; normals and albedo have none. */
export function legendOf(picture: MapPicture | null) {
  if (picture?.low == null || picture.high == null || picture.name === "albedo") return nothing;
  return colourLegend(picture.name, picture.low, picture.high);
}
