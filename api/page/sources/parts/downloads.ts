/** Files of the API that the browser opens or saves itself, with a ticket in the address if keys are in use. */
import { attempt } from "../connection/actions";
import { openable } from "../connection/requests";
import { t } from "../words/language";
import { save } from "./save";

export async function openInTab(address: string): Promise<void> {
  await attempt(t("result.downloads"), async () => window.open(await openable(address), "_blank", "noopener"));
}

export async function download(address: string, name: string): Promise<void> {
  await attempt(name, async () => save(await openable(address), name));
}
