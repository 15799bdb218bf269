/**
 * Jogging under a dead-man: the request is repeated while a button is held, and the arm comes to rest when it ceases.
 *
 * Every press has its own name. Once its motion has ended, the service moves nothing more under that name. At most two
 * requests are under way at the same time, so that a slow network delays the next one instead of queuing them.
 */
import { randomName } from "./random-name";
import { live } from "./live";
import { post, send, Unreachable } from "./requests";

/** One joint (0: the base), or one axis of the base frame, and the direction. */
export type JogMotion = { direction: -1 | 1 } & ({ joint: number } | { axis: "x" | "y" | "z" });

/** Time between two renewals, ms; the service ends the motion 300 ms after the last one. */
const RENEW_MS = 100;
const AT_ONCE = 2;
/** Time limit of a request, ms: preparing the arm for the first step takes seconds. */
const TIMEOUT_MS = 20_000;

/** Time after which a press moves nothing, s: an outage may have delayed it, and the button is released by then. */
const WANTED_S = 2;

export class Jogging {
  private timer = 0;
  private hold = "";
  private abort = new AbortController();
  private running = 0;

  /** `ended` is called with the reason when a motion ends other than by release. */
  constructor(private readonly ended: (error: unknown) => void) {}

  get held(): boolean {
    return this.hold !== "";
  }

  /** Starts the motion when a button goes down. */
  press(motion: JogMotion): void {
    this.release();
    this.hold = randomName();
    this.abort = new AbortController();
    void this.renew(motion, this.hold);
    this.timer = window.setInterval(() => void this.renew(motion, this.hold), RENEW_MS);
  }

  /** Ends the motion when the button comes up, or is released in another way. */
  release(): void {
    if (!this.held) return;
    const { hold } = this;
    this.hold = "";
    clearInterval(this.timer);
    this.abort.abort();
    // Named, so that a press which this request overtakes moves nothing. If it is lost, the arm rests 0.3 s later.
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
