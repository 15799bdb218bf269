/** Actions of a session; what fails is shown on whatever screen is open then. */
import { live } from "./live";
import { post, send, UNLIMITED } from "./requests";
import type { Session } from "./schemas";

/** Start and resume connect to the devices and check them first. */
export async function act(id: string, action: string, more: Record<string, unknown> = {}): Promise<void> {
  try {
    await post(`/v1/sessions/${id}/actions`, { action, ...more }, { timeoutMs: UNLIMITED });
    live.fail(null);
  } catch (error) {
    live.fail(error);
  }
  live.refreshSession(id);
  live.refreshRig();
}

/** Changes a session's label, notes or answer. */
export async function edit(id: string, change: { label?: string; notes?: string; answer?: number }): Promise<void> {
  try {
    const answer = await send("PATCH", `/v1/sessions/${id}`, { body: change });
    live.learn((await answer.json()) as Session);
    live.fail(null);
  } catch (error) {
    live.fail(error);
  }
}
