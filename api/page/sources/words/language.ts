/** The page's language: at first the browser's, then the chosen one. Numbers and times follow it. */
import { de } from "./de";
import { en } from "./en";

export type Language = "en" | "de";
export type Word = keyof typeof en;

const NAME = "lightpose-language";
const WORDS: Record<Language, Record<Word, string>> = { en, de };
/** Region whose format numbers and times have. */
const REGION: Record<Language, string> = { en: "en-GB", de: "de-DE" };
const listeners = new Set<() => void>();

let chosen: Language = initial();
document.documentElement.lang = chosen;

function initial(): Language {
  const stored = localStorage.getItem(NAME);
  if (stored === "en" || stored === "de") return stored;
  return navigator.language.startsWith("de") ? "de" : "en";
}

export function language(): Language {
  return chosen;
}

export function choose(next: Language): void {
  chosen = next;
  localStorage.setItem(NAME, next);
  document.documentElement.lang = next;
  listeners.forEach((listener) => listener());
}

/** Calls back after a change of the language. Returns a function that ends this. */
export function onLanguage(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Returns the words of a key in the present language, with `{name}` replaced by its value. */
export function t(word: Word, values: Record<string, string | number> = {}): string {
  return WORDS[chosen][word].replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}

/** Returns the words of a composed key if there are any, else `otherwise`. */
export function tOr(word: string, otherwise: string): string {
  return (WORDS[chosen] as Record<string, string>)[word] ?? otherwise;
}

export function number(value: number | null | undefined, digits = 2): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toLocaleString(REGION[chosen], { minimumFractionDigits: digits, maximumFractionDigits: digits });
}

/** Formats a number with all its digits. */
export function exact(value: number): string {
  return value.toLocaleString(REGION[chosen]);
}

export function degrees(value: number | null | undefined, digits = 2): string {
  return value === null || value === undefined ? "–" : `${number(value, digits)}°`;
}

export function percent(share: number, digits = 0): string {
  return `${number(100 * share, digits)}\u00a0%`;
}

/** Formats a time, s, in milliseconds: whole ones, or three digits of shorter times. */
export function milliseconds(seconds: number): string {
  const ms = 1e3 * seconds;
  return `${ms < 100 ? ms.toLocaleString(REGION[chosen], { maximumSignificantDigits: 3 }) : number(ms, 0)}\u00a0ms`;
}

export function when(time: string | null | undefined): string {
  return time ? new Date(time).toLocaleString(REGION[chosen], { dateStyle: "medium", timeStyle: "short" }) : "–";
}

export function clock(time: string | number): string {
  return new Date(time).toLocaleTimeString(REGION[chosen]);
}

/** Formats a duration: "40 s", "12 min". */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${number(seconds / 3600, 1)} h`;
}
