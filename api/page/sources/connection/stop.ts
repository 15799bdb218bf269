/**
 * The stop: sent at once, and again every half second until the service has confirmed it.
 *
 * It shares nothing with the rest of the page: neither the event stream nor its state, and it does not wait for an
 * attempt that hangs before it makes the next one. It works with every key.
 */
import { authorization, storedKey } from "./credentials";
import { hurry } from "./events";

const AGAIN_MS = 500;
/** Time limit of one attempt, ms. */
const ATTEMPT_MS = 3_000;
/** After this time without an answer the person is told that the stop was not heard, ms. */
export const UNHEARD_MS = 1_000;
/** No key, not allowed, too many wrong keys (a valid one is accepted all the same): to try again would not help. */
const REFUSALS = new Set([401, 403, 429]);
/** How long it is tried, ms. */
const GIVE_UP_MS = 120_000;

export type StopState =
  | { kind: "none" }
  | { kind: "sent"; attempts: number; sinceMs: number }
  | { kind: "heard"; attempts: number; tookMs: number }
  | { kind: "refused"; status: number }
  | { kind: "unheard"; attempts: number; sinceMs: number };

let pressed = 0;

/** Sends the stop until it is heard; `tell` is called with each change. A later press replaces an earlier one. */
export function stop(tell: (state: StopState) => void): void {
  const press = ++pressed;
  const start = performance.now();
  let attempts = 0;
  let over = false;
  const since = (): number => Math.round(performance.now() - start);
  const attempt = async (): Promise<void> => {
    attempts += 1;
    try {
      const response = await fetch("/v1/rig/stop", {
        method: "POST",
        headers: authorization(storedKey()),
        signal: AbortSignal.timeout(ATTEMPT_MS),
        keepalive: true,
        priority: "high",
      });
      if (over) return;
      if (response.ok) finish({ kind: "heard", attempts, tookMs: since() });
      else if (REFUSALS.has(response.status)) finish({ kind: "refused", status: response.status });
    } catch {
      // Not reached: the next attempt follows, and the person is told.
    }
  };
  const finish = (state: StopState): void => {
    over = true;
    clearInterval(timer);
    if (press === pressed) tell(state);
  };
  const timer = window.setInterval(() => {
    if (press !== pressed || since() > GIVE_UP_MS) over = true;
    if (over) return clearInterval(timer);
    void attempt();
    tell({ kind: since() < UNHEARD_MS ? "sent" : "unheard", attempts, sinceMs: since() });
  }, AGAIN_MS);
  void attempt();
  hurry();
  tell({ kind: "sent", attempts, sinceMs: 0 });
}
