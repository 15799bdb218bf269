/** Names for what has only numbers. */
import type { Session } from "../connection/schemas";
import { t, tOr, type Word } from "./language";

/** Whether a session's images are taken with the lamp in chosen places. Other sessions' images show the board. */
function isLit(recipe: Session["recipe"]): boolean {
  return ["capture", "lamp", "response"].includes(recipe.kind) || ("target" in recipe && recipe.target === "plane");
}

/** A session's label; without one the kind of its calibration, or its number. */
export function sessionName({ label, number, recipe }: Session): string {
  if (label) return label;
  const kind = recipe.kind ?? "capture";
  return `${kind === "capture" ? t("session") : tOr(`kind.${kind}`, kind)} ${number}`;
}

/** Name of a session's image, by the number of its light or view from 0. */
export function imageName({ recipe }: Session, number: number): string {
  const word = recipe.kind === "response" ? "progress.image" : isLit(recipe) ? "progress.light" : "view.name";
  return t(word, { number: number + 1 });
}

export function stageName({ recipe }: Session, stage: string): string {
  return t(stage === "plan" && !isLit(recipe) ? "stage.views" : (`stage.${stage}` as Word));
}
