/** Names for people of what has only numbers. */
import type { Session } from "../connection/schemas";
import { t, tOr, type Word } from "./language";

/** Kinds of sessions whose images are taken with the lamp; those of the others show the calibration board. */
const WITH_LAMP = new Set(["capture", "lamp", "response"]);

/** A session's label; without one what it calibrates, or its number. */
export function sessionName({ label, number, recipe }: Session): string {
  if (label) return label;
  const kind = recipe.kind ?? "capture";
  return `${kind === "capture" ? t("session") : tOr(`kind.${kind}`, kind)} ${number}`;
}

/** What an image of a session is called, by the number of its light or view from 0. */
export function imageName({ recipe }: Session, number: number): string {
  const { kind } = recipe;
  const word = kind === "response" ? "progress.image" : WITH_LAMP.has(kind) ? "progress.light" : "view.name";
  return t(word, { number: number + 1 });
}

export function stageName({ recipe }: Session, stage: string): string {
  return t(stage === "plan" && !WITH_LAMP.has(recipe.kind) ? "stage.views" : (`stage.${stage}` as Word));
}
