/** Titles and remedies of problem codes; the service's own English ones where this page has no words for a code. */
import { REMEDIES } from "./de-remedies";
import { language, tOr } from "./language";

export function problemTitle(code: string, title = code): string {
  return tOr(`problem.${code}`, title);
}

/** The remedy as the service gives it (English), or this page's translation. */
export function remedyOf(code: string, remedy: string): string {
  return language() === "en" ? remedy : (REMEDIES[code] ?? remedy);
}
