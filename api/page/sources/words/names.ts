/** Names for people of what has only numbers. */
import type { Session } from "../connection/schemas";
import { t, tOr } from "./language";

/** A session's label; without one what it calibrates, or its number. */
export function sessionName({ label, number, recipe }: Session): string {
  if (label) return label;
  const kind = recipe.kind ?? "capture";
  return `${kind === "capture" ? t("session") : tOr(`kind.${kind}`, kind)} ${number}`;
}
