/**
 * Jogging under a dead-man: the request is repeated while a button is held, and the arm rests when it ceases.
 *
 * Every press has a name of its own; once its motion has ended, the service moves nothing more by that name. At most two
 * requests are under way at once, so that a slow network delays the next one instead of piling them up.
 */
import { randomName } from "./random-name";
import { live } from "./live";
import { post, send, Unreachable } from "./requests";

/** One joint (0: the base), or one axis of the base frame, and the direction. */
export type JogMotion = { direction: -1 | 1 } & ({ joint: number } | { axis: "x" | "y" | "z" });

/** Time between two renewals, ms; the service ends the motion 300 ms after the last one. */
const RENEW_MS = 100;
const AT_ONCE = 2;
/** Making the arm ready for the first step takes seconds, ms. */
const TIMEOUT_MS = 20_000;

/** A press that arrives later than this moves nothing, s: an outage may have held it up, and the hand is gone. */
const WANTED_S = 2;

export class Jogging {
  private timer = 0;
  private hold = "";
  private abort = new AbortController();
  private running = 0;

  /** `ended` is called when a motion ends otherwise than by release, with the reason. */
  constructor(private readonly ended: (error: unknown) => void) {}

  get held(): boolean {
    return this.hold !== "";
  }

  /** A button goes down. */
  press(motion: JogMotion): void {
    this.release();
    this.hold = randomName();
    this.abort = new AbortController();
    void this.renew(motion, this.hold);
    this.timer = window.setInterval(() => void this.renew(motion, this.hold), RENEW_MS);
  }

  /** The button comes up, or the hand is gone in another way. */
  release(): void {
    if (!this.held) return;
    const { hold } = this;
    this.hold = "";
    clearInterval(this.timer);
    this.abort.abort();
    // Named, so that a press which this overtakes moves nothing; without it, the arm rests 0.3 s later.
    void send("POST", "/v1/rig/jog/release", { body: { hold } }).catch(() => undefined);
  }

  private async renew(motion: JogMotion, hold: string): Promise<void> {
    if (this.running >= AT_ONCE) return;
    this.running += 1;
    const { signal } = this.abort;
    try {
      const headers = live.validFor(WANTED_S);
      if (!headers) throw new Unreachable("jog");
      await post("/v1/rig/jog", { ...motion, hold }, { headers, signal, timeoutMs: TIMEOUT_MS });
    } catch (error) {
      if (hold === this.hold) {
        this.hold = "";
        clearInterval(this.timer);
        this.ended(error);
      }
    } finally {
      this.running -= 1;
    }
  }
}
