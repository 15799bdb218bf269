/** Actions of a person: the bar shows that they are being sent, and by their name how they failed. */
import { t, type Word } from "../words/language";
import { live } from "./live";
import { randomName } from "./random-name";
import { post, send, Unreachable, UNLIMITED, type RequestOptions } from "./requests";
import type { Session } from "./schemas";

/** Time after the press within which the arm may begin to move, s. */
export const WANTED_S = 5;
/** Actions after which the arm moves. */
const MOVES = new Set(["start", "resume"]);
/** Time between two checks of whether the service still answers, ms. */
const WATCH_MS = 250;

/** Carries out a person's request under this name. Returns whether it succeeded. */
export async function attempt(name: string, request: () => Promise<unknown>): Promise<boolean> {
  const sent = live.send(name);
  try {
    await request();
    live.fail(null);
    return true;
  } catch (error) {
    live.fail({ name, error });
    return false;
  } finally {
    sent();
  }
}

/**
 * Carries out a request that moves the arm.
 *
 * Each of its single requests is made with newly requested options: it is not carried out if it arrives late. When the
 * service is not heard any more, the request under way and all that would follow are abandoned.
 */
export function attemptMove(
  name: string,
  request: (options: () => RequestOptions) => Promise<unknown>,
): Promise<boolean> {
  return attempt(name, async () => {
    const abort = new AbortController();
    const watch = setInterval(() => live.unheard && abort.abort(), WATCH_MS);
    const options = (): RequestOptions => {
      const headers = live.validFor(WANTED_S);
      if (!headers) throw new Unreachable(name);
      return { headers, signal: abort.signal, timeoutMs: UNLIMITED };
    };
    try {
      await request(options);
    } catch (error) {
      throw abort.signal.aborted ? new Unreachable(name) : error;
    } finally {
      clearInterval(watch);
    }
  });
}

/** Performs an action. Start and resume first connect to the devices and check them. */
export async function act(id: string, action: string, more: Record<string, unknown> = {}): Promise<void> {
  const name = t(`action.${action}` as Word);
  const ask = (options: RequestOptions): Promise<unknown> =>
    post(`/v1/sessions/${id}/actions`, { action, ...more }, options);
  if (MOVES.has(action)) await attemptMove(name, (options) => ask(options()));
  else await attempt(name, () => ask({ timeoutMs: UNLIMITED }));
  live.refreshSession(id);
  live.refreshRig();
}

/** Changes a session's label, notes or answer. Returns whether it succeeded. */
export function edit(
  name: string,
  id: string,
  change: { label?: string; notes?: string; answer?: number },
): Promise<boolean> {
  return attempt(name, async () => {
    const answer = await send("PATCH", `/v1/sessions/${id}`, { body: change });
    live.learn((await answer.json()) as Session);
  });
}

/**
 * Creates a session of a recipe, opens its screen, and starts it if `start` is set. The start is not sent if the
 * creation took too long. Throws the error of the creation.
 */
export async function create(recipe: Record<string, unknown>, start: boolean): Promise<void> {
  const pressed = performance.now();
  const name = t(start ? "action.start" : "start.create");
  const sent = live.send(name);
  try {
    const headers = { "Idempotency-Key": randomName(), ...(start ? live.validFor(WANTED_S) : {}) };
    const session = await post<Session>("/v1/sessions", recipe, { headers });
    live.learn(session);
    const opened = new Promise((resolve) => window.addEventListener("hashchange", resolve, { once: true }));
    location.hash = `#/sessions/${session.id}`;
    await opened;
    if (!start) return;
    if (performance.now() - pressed > WANTED_S * 1e3) live.fail({ name, error: new Unreachable(name) });
    else await act(session.id, "start");
  } finally {
    sent();
  }
}
