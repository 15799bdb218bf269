/** The archive's words in the language of the page, with `{name}` replaced by its value. */
import { archiveDe } from "./archive-de";
import { archiveEn } from "./archive-en";
import { language } from "./language";

export type ArchiveWord = keyof typeof archiveEn;

export function a(word: ArchiveWord, values: Record<string, string | number> = {}): string {
  const words: Record<ArchiveWord, string> = language() === "de" ? archiveDe : archiveEn;
  return words[word].replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}
