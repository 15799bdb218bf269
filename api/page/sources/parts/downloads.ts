/** Files of the API that the browser itself opens or saves: with a ticket in the address where keys are in use. */
import { live } from "../connection/live";
import { openable } from "../connection/requests";
import { save } from "./save";

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
