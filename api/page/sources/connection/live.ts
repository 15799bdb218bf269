/**
 * The page's knowledge of the service: caller, rig, sessions, the age of the connection.
 *
 * Everything is read from the API, and read again when an event reports a change. A limited number of events is kept
 * for the screens that show what happened. `LiveController` draws the elements again that show any of this.
 */
import type { ReactiveController, ReactiveControllerHost } from "lit";
import { storedKey, storeKey } from "./credentials";
import { follow } from "./events";
import type { StreamStatus } from "./event-stream";
import { get, Refusal } from "./requests";
import type { Caller, JointReading, JournalEvent, Rig, Session } from "./schemas";

/** Number of events kept for display. */
const KEPT_EVENTS = 400;
/** Number of sessions kept as last read; they are read again when the connection is back. */
const KEPT_SESSIONS = 20;
/** Minimum time between two readings of the same thing, ms. */
const PACE_MS = 250;
/** Maximum time between two readings of the rig while the page is visible, ms. */
const REFRESH_MS = 5_000;
/** Age above which a reading of the rig is old although the service answers, ms. */
const RIG_OLD_MS = 15_000;
/** Age above which joint readings do not describe the present, ms. */
const JOINTS_OLD_MS = 2_000;
/** Maximum time between two readings of the running session for its time left, ms. */
const PROGRESS_MS = 2_000;
/** Silence after which a connection is stale, ms. */
export const STALE_MS = 3_500;
/** Pause before the caller is read again if nothing answers, ms. */
const BEGIN_AGAIN_MS = 1_000;

/** An error of the page's request, and the name by which the person knows the request. */
export interface Failure {
  name: string;
  error: unknown;
}

/** Outcome of the last given key. */
export type KeyProblem = "wrong" | "crowded" | "unreached" | null;

/** Why an answer requires a key: it is missing or unknown, or too many wrong ones came from this machine. */
function keyProblem(error: unknown): KeyProblem {
  if (!(error instanceof Refusal)) return "unreached";
  if (error.problem.status === 401) return "wrong";
  return error.problem.code === "request.too_many_failures" ? "crowded" : "unreached";
}

class Live extends EventTarget {
  caller: Caller | null = null;
  keyNeeded = false;
  keyProblem: KeyProblem = null;
  rig: Rig | null = null;
  /** When the rig was last read, at first when it was first requested, ms since 1970; 0: not requested yet. */
  rigReadAt = 0;
  /** Who started or resumed the session that holds the rig. */
  inCharge: string | null = null;
  stream: StreamStatus = { open: false, heardAt: 0, roundTripMs: null, refused: null };
  events: JournalEvent[] = [];
  joints: JointReading | null = null;
  /** Names of the actions that are being sent. */
  sending: readonly string[] = [];
  private jointsAt = 0;
  private wasStale = false;
  private retry = 0;
  private readonly known = new Map<string, Session>();
  private readonly missing = new Set<string>();
  private readonly due = new Map<string, number>();
  private readonly again = new Set<string>();
  private started = false;

  /** Reads the caller, asks for a key if there is no valid one, and then follows the events. */
  async begin(): Promise<void> {
    clearTimeout(this.retry);
    try {
      this.caller = await get<Caller>("/v1/caller");
      this.keyNeeded = false;
      this.keyProblem = null;
    } catch (error) {
      const problem = keyProblem(error);
      if (problem === "unreached") this.retry = window.setTimeout(() => void this.begin(), BEGIN_AGAIN_MS);
      else this.keyNeeded = true;
      this.keyProblem = storedKey() ? problem : null;
      if (problem === "wrong") storeKey("");
      this.changed();
      return;
    }
    this.known.clear();
    this.missing.clear();
    follow({
      event: (event) => this.take(event),
      joints: (reading) => this.read(reading),
      status: (status) => this.hear(status),
    });
    this.rigReadAt = Date.now();
    this.refreshRig();
    if (!this.started) {
      const refresh = (): void => {
        if (document.visibilityState === "visible" && !this.keyNeeded) this.refreshRig();
      };
      setInterval(refresh, REFRESH_MS);
      document.addEventListener("visibilitychange", refresh);
      setInterval(() => this.readProgress(), PROGRESS_MS);
      setInterval(() => this.tick(), 500);
    }
    this.started = true;
    this.changed();
  }

  /** Whether the service has been silent for a while. */
  get unheard(): boolean {
    // Before the service's first answer the page is new, not stale. Without a key it follows nothing yet.
    if (this.stream.heardAt === 0) return !this.keyNeeded && performance.now() > STALE_MS;
    return Date.now() - this.stream.heardAt > STALE_MS;
  }

  /** Whether the service answers but does not report the state of the rig. */
  get rigOld(): boolean {
    return this.rigReadAt > 0 && !this.keyNeeded && Date.now() - this.rigReadAt > RIG_OLD_MS;
  }

  /** Whether the displayed state is old. */
  get stale(): boolean {
    return this.unheard || this.rigOld;
  }

  /** Whether the arm moves now; null: unknown. */
  get moving(): boolean | null {
    const { joints } = this;
    if (this.stale || !this.stream.open || !joints?.connected) return null;
    return performance.now() - this.jointsAt > JOINTS_OLD_MS ? null : joints.moving;
  }

  /**
   * The header of a request that must be carried out within `seconds`, by the service's clock, or not at all: the
   * kernel may still send a request that this page has given up. Null while the service's clock is unknown.
   */
  validFor(seconds: number): Record<string, string> | null {
    if (!this.joints) return null;
    const now = Date.parse(this.joints.at) / 1e3 + (performance.now() - this.jointsAt) / 1e3;
    return { "Valid-Until": (now + seconds).toFixed(3) };
  }

  get mayOperate(): boolean {
    return this.caller !== null && this.caller.role !== "viewer";
  }

  get mayDelete(): boolean {
    return this.caller?.role === "admin";
  }

  /** Whether there is no such session. */
  isMissing(id: string): boolean {
    return this.missing.has(id);
  }

  /** A session as last read; an unknown one is read. */
  session(id: string): Session | null {
    if (!this.known.has(id) && !this.missing.has(id)) this.refreshSession(id);
    return this.known.get(id) ?? null;
  }

  /** The session that holds the rig. */
  get holder(): Session | null {
    return this.rig?.holder ? this.session(this.rig.holder) : null;
  }

  refreshRig(): void {
    this.paced("rig", async () => {
      this.rig = await get<Rig>("/v1/rig");
      this.rigReadAt = Date.now();
      const holder = this.rig.holder;
      if (holder === null) this.inCharge = null;
      else {
        const { items } = await get<{ items: { action: string; actor: string; outcome: string }[] }>(
          `/v1/sessions/${holder}/actions`,
        );
        const taken = items.filter((item) => ["start", "resume"].includes(item.action) && item.outcome !== "refused");
        this.inCharge = taken.at(-1)?.actor ?? null;
      }
    });
  }

  refreshSession(id: string): void {
    this.paced(id, async () => {
      try {
        this.remember(await get<Session>(`/v1/sessions/${id}`));
      } catch (error) {
        if (!(error instanceof Refusal && error.problem.status === 404)) throw error;
        this.known.delete(id);
        this.missing.add(id);
      }
    });
  }

  /** Error of the last action, until it is dismissed or another screen is opened. */
  failure: Failure | null = null;

  fail(failure: Failure | null): void {
    this.failure = failure;
    this.changed();
  }

  /** Marks an action as being sent until the returned function is called. */
  send(name: string): () => void {
    this.sending = [...this.sending, name];
    this.changed();
    return () => {
      const place = this.sending.indexOf(name);
      this.sending = this.sending.filter((_, index) => index !== place);
      this.changed();
    };
  }

  /** Takes a session from the answer to an action. */
  learn(session: Session): void {
    this.remember(session);
    this.changed();
  }

  /** Keeps a session as read; of many sessions only those read last. */
  private remember(session: Session): void {
    this.known.delete(session.id);
    this.known.set(session.id, session);
    if (this.known.size > KEPT_SESSIONS) this.known.delete(this.known.keys().next().value!);
  }

  private take(event: JournalEvent): void {
    this.events.push(event);
    if (this.events.length > KEPT_EVENTS) this.events.splice(0, this.events.length - KEPT_EVENTS);
    if (event.session_id && this.known.has(event.session_id)) this.refreshSession(event.session_id);
    if (/^(session\.(state|deleted)|calibration\.|safety\.|device\.|rig\.)/.test(event.type)) this.refreshRig();
    this.dispatchEvent(new CustomEvent("journal", { detail: event }));
    this.changed();
  }

  private readProgress(): void {
    const { holder } = this;
    if (document.visibilityState === "visible" && holder?.state === "running") this.refreshSession(holder.id);
  }

  private tick(): void {
    this.dispatchEvent(new Event("tick"));
    if (this.stale !== this.wasStale) this.changed();
    this.wasStale = this.stale;
  }

  private read(reading: JointReading): void {
    const begunOrEnded = reading.moving !== this.joints?.moving;
    this.joints = reading;
    this.jointsAt = performance.now();
    this.dispatchEvent(new Event("joints"));
    if (begunOrEnded) this.changed();
  }

  private hear(status: StreamStatus): void {
    const reopened = status.open && !this.stream.open;
    this.stream = status;
    if (status.refused === 401) this.keyNeeded = true;
    if (reopened) {
      this.dispatchEvent(new Event("reopened"));
      this.refreshRig();
      for (const id of this.known.keys()) this.refreshSession(id);
    }
    this.changed();
  }

  /** Runs a reading now, or once more after the present one and a pause, however often it is requested. */
  private paced(name: string, read: () => Promise<void>): void {
    if (this.due.has(name)) {
      this.again.add(name);
      return;
    }
    this.due.set(name, 1);
    void read()
      .catch((error: unknown) => {
        // Not reached: the age of the connection shows that, and it is read again when the connection is back.
        // Revoked meanwhile: of many wrong keys of a machine too, because a valid one is never refused as `crowded`.
        if (keyProblem(error) !== "unreached") this.keyNeeded = true;
      })
      .finally(() => {
        this.changed();
        setTimeout(() => {
          this.due.delete(name);
          if (this.again.delete(name)) this.paced(name, read);
        }, PACE_MS);
      });
  }

  private changed(): void {
    this.dispatchEvent(new Event("change"));
  }
}

export const live = new Live();

declare global {
  interface Window {
    /** The page's knowledge, for the browser's console and for tests. */
    lightpose: Live;
  }
}
window.lightpose = live;

/** Draws its element again when the page's knowledge changes, and with `tick` also twice a second. */
export class LiveController implements ReactiveController {
  private readonly update = (): void => this.host.requestUpdate();

  constructor(
    private readonly host: ReactiveControllerHost,
    private readonly kinds: readonly ("change" | "tick" | "joints")[] = ["change"],
  ) {
    host.addController(this);
  }

  hostConnected(): void {
    for (const kind of this.kinds) live.addEventListener(kind, this.update);
  }

  hostDisconnected(): void {
    for (const kind of this.kinds) live.removeEventListener(kind, this.update);
  }
}

/** Passes each event of the journal to its element while that is in the document. */
export class JournalController implements ReactiveController {
  private readonly tell = (event: Event): void => this.hear((event as CustomEvent<JournalEvent>).detail);

  constructor(
    host: ReactiveControllerHost,
    private readonly hear: (event: JournalEvent) => void,
  ) {
    host.addController(this);
  }

  hostConnected(): void {
    live.addEventListener("journal", this.tell);
  }

  hostDisconnected(): void {
    live.removeEventListener("journal", this.tell);
  }
}
