/** Titles and remedies of problem codes; the service's English ones if this page has no words for a code. */
import { REMEDIES } from "./de-remedies";
import { language, tOr } from "./language";

export function problemTitle(code: string, title = code): string {
  return tOr(`problem.${code}`, title);
}

/** The remedy: the page's own where it differs from a script's, else the service's, or its translation. */
export function remedyOf(code: string, remedy: string): string {
  const own = tOr(`remedy.${code}`, "");
  return own || (language() === "en" ? remedy : (REMEDIES[code] ?? remedy));
}
