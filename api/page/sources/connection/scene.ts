/** The cell's geometry, read once and kept, and read again when the reach has become known. */
import type { components } from "./api-types";
import { get } from "./requests";

export type Scene = components["schemas"]["SceneResource"];
export type Body = Scene["bodies"][number];

let known: Promise<Scene> | null = null;

export function scene(): Promise<Scene> {
  known ??= get<Scene>("/v1/rig/scene").then(
    (read) => {
      if (read.lights === null) known = null; // the candidates follow once the reach is computed
      return read;
    },
    (error: unknown) => {
      known = null;
      throw error;
    },
  );
  return known;
}
