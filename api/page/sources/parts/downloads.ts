/** Files of the API that the browser itself opens or saves: with a ticket in the address where keys are in use. */
import { live } from "../connection/live";
import { openable } from "../connection/requests";

export async function openInTab(address: string): Promise<void> {
  try {
    window.open(await openable(address), "_blank", "noopener");
  } catch (error) {
    live.fail(error);
  }
}

export async function download(address: string, name: string): Promise<void> {
  try {
    save(await openable(address), name);
  } catch (error) {
    live.fail(error);
  }
}

/** Saves what stands at an address under a name. */
export function save(address: string, name: string): void {
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
}
