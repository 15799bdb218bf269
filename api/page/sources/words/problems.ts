/** Titles and remedies of problem codes; the service's own English ones where this page has no words for a code. */
import { REMEDIES } from "./de-remedies";
import { language, tOr } from "./language";

export function problemTitle(code: string, title = code): string {
  return tOr(`problem.${code}`, title);
}

/** What to do: on this page, where that differs from a script's way; else as the service says, or translated. */
export function remedyOf(code: string, remedy: string): string {
  const own = tOr(`remedy.${code}`, "");
  return own || (language() === "en" ? remedy : (REMEDIES[code] ?? remedy));
}
