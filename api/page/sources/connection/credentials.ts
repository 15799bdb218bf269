/**
 * The caller's key, empty on a machine without keys. It is only in this tab's session storage, so that it ends with the
 * tab and no other page of the browser can read it.
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
