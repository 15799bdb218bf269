/**
 * The caller's key: in this tab's session storage alone, so that it ends with the tab and no other page of the browser
 * can read it; empty on a machine without keys.
 */
const NAME = "lightpose-key";

export function storedKey(): string {
  return sessionStorage.getItem(NAME) ?? "";
}

export function storeKey(key: string): void {
  if (key) sessionStorage.setItem(NAME, key);
  else sessionStorage.removeItem(NAME);
}

export function authorization(key: string): Record<string, string> {
  return key ? { Authorization: `Bearer ${key}` } : {};
}
