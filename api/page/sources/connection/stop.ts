/**
 * The stop: sent at once, and again every half second until the service has confirmed it, however long that takes.
 *
 * It shares nothing with the rest of the page, neither the event stream nor the page's state. It does not wait for a
 * hanging attempt before it makes the next one. It works with every key.
 */
import { authorization, storedKey } from "./credentials";
import { hurry } from "./events";

const AGAIN_MS = 500;
/** Time limit of one attempt, ms. */
const ATTEMPT_MS = 3_000;
/** Time without an answer after which the person is told that the stop was not received, ms. */
export const UNHEARD_MS = 1_000;
/** Statuses that a repetition would not change: no key, not allowed, too many wrong keys (a valid one still works). */
const REFUSALS = new Set([401, 403, 429]);
export type StopState =
  | { kind: "none" }
  | { kind: "sent"; attempts: number; sinceMs: number }
  | { kind: "heard"; attempts: number; tookMs: number }
  | { kind: "refused"; status: number }
  | { kind: "unheard"; attempts: number; sinceMs: number };

/** A stop that has not been confirmed yet, from its first press on. */
interface Unheard {
  start: number;
  attempts: number;
  timer: number;
  tell: (state: StopState) => void;
}

let unheard: Unheard | null = null;

/**
 * Sends the stop until it is confirmed; `tell` is called with each change. A further press of an unconfirmed stop sends
 * it again at once, but time and attempts are counted from the first press.
 */
export function stop(tell: (state: StopState) => void): void {
  const current = (unheard ??= begun());
  current.tell = tell;
  void attempt(current);
  hurry();
  say(current);
}

function begun(): Unheard {
  const made: Unheard = { start: performance.now(), attempts: 0, timer: 0, tell: () => undefined };
  made.timer = window.setInterval(() => {
    void attempt(made);
    say(made);
  }, AGAIN_MS);
  return made;
}

function since(one: Unheard): number {
  return Math.round(performance.now() - one.start);
}

function say(one: Unheard): void {
  const sinceMs = since(one);
  one.tell({ kind: sinceMs < UNHEARD_MS ? "sent" : "unheard", attempts: one.attempts, sinceMs });
}

async function attempt(one: Unheard): Promise<void> {
  one.attempts += 1;
  try {
    const response = await fetch("/v1/rig/stop", {
      method: "POST",
      headers: authorization(storedKey()),
      signal: AbortSignal.timeout(ATTEMPT_MS),
      keepalive: true,
      priority: "high",
    });
    if (one !== unheard) return;
    if (response.ok) finish(one, { kind: "heard", attempts: one.attempts, tookMs: since(one) });
    else if (REFUSALS.has(response.status)) finish(one, { kind: "refused", status: response.status });
  } catch {
    // Not reached: the next attempt follows, and the person is told.
  }
}

function finish(one: Unheard, state: StopState): void {
  clearInterval(one.timer);
  unheard = null;
  one.tell(state);
}
