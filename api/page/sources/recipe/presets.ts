/** Common recipes, as values that differ from the schema's defaults. */
import type { Word } from "../words/language";
import type { Values } from "./recipe-form";

export interface Preset {
  name: Word;
  explanation: Word;
  values: Values;
}

export const PRESETS: Preset[] = [
  { name: "preset.quick", explanation: "preset.quick.why", values: { pilot_lights: 4, planned_lights: 0 } },
  { name: "preset.standard", explanation: "preset.standard.why", values: { pilot_lights: 4, planned_lights: 4 } },
  { name: "preset.thorough", explanation: "preset.thorough.why", values: { pilot_lights: 4, planned_lights: 12 } },
  {
    name: "preset.target",
    explanation: "preset.target.why",
    values: { pilot_lights: 4, planned_lights: 0, target_sigma_deg: 0.7, max_lights: 24 },
  },
  {
    name: "preset.reviewed",
    explanation: "preset.reviewed.why",
    values: { pilot_lights: 4, planned_lights: 4, review_plan: true },
  },
];
