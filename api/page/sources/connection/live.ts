/**
 * What the page knows of the service: caller, rig, sessions, the age of the connection.
 *
 * Everything is read from the API and read again when an event says that it has changed; the events themselves are
 * kept, a limited number of them, for the screens that tell what happened. Elements that show any of it are
 * drawn again through `LiveController`.
 */
import type { ReactiveController, ReactiveControllerHost } from "lit";
import { follow } from "./events";
import type { StreamStatus } from "./event-stream";
import { get, Refusal } from "./requests";
import type { Caller, JointReading, JournalEvent, Rig, Session } from "./schemas";

/** Events kept for display. */
const KEPT_EVENTS = 400;
/** Sessions kept as last read; they are read again when the connection is back. */
const KEPT_SESSIONS = 20;
/** Least time between two readings of the same thing, ms. */
const PACE_MS = 250;
/** The rig is read at least so often while the page is visible, ms. */
const REFRESH_MS = 10_000;
/** The session that runs is read at least so often, for its time left, ms. */
const PROGRESS_MS = 2_000;
/** Answers to a caller without a valid key: it needs one, or too many wrong ones came from this machine. */
const KEYLESS = new Set([401, 429]);
/** A connection that was last heard this long ago is stale, ms. */
export const STALE_MS = 3_500;

class Live extends EventTarget {
  caller: Caller | null = null;
  keyNeeded = false;
  rig: Rig | null = null;
  /** Who started or resumed the session that holds the rig. */
  inCharge: string | null = null;
  stream: StreamStatus = { open: false, heardAt: 0, roundTripMs: null, refused: null };
  events: JournalEvent[] = [];
  joints: JointReading | null = null;
  private readonly known = new Map<string, Session>();
  private readonly missing = new Set<string>();
  private readonly due = new Map<string, number>();
  private readonly again = new Set<string>();
  private started = false;

  /** Reads the caller; without a valid key the page asks for one. Then follows the events. */
  async begin(): Promise<void> {
    try {
      this.caller = await get<Caller>("/v1/caller");
      this.keyNeeded = false;
    } catch (error) {
      if (error instanceof Refusal && KEYLESS.has(error.problem.status)) this.keyNeeded = true;
      else setTimeout(() => void this.begin(), 1_000);
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
    this.refreshRig();
    if (!this.started) {
      setInterval(() => document.visibilityState === "visible" && !this.keyNeeded && this.refreshRig(), REFRESH_MS);
      setInterval(() => this.readProgress(), PROGRESS_MS);
      setInterval(() => this.dispatchEvent(new Event("tick")), 500);
    }
    this.started = true;
    this.changed();
  }

  get stale(): boolean {
    // Before the first word of the service the page is young, not stale; without a key it follows nothing yet.
    if (this.stream.heardAt === 0) return !this.keyNeeded && performance.now() > STALE_MS;
    return Date.now() - this.stream.heardAt > STALE_MS;
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

  /** A session as last read; it is read when it is not known yet. */
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

  /** What the last action failed with, until it is dismissed. */
  failure: unknown = null;

  fail(error: unknown): void {
    this.failure = error;
    this.changed();
  }

  /** Takes a session as an action's answer gave it. */
  learn(session: Session): void {
    this.remember(session);
    this.changed();
  }

  /** Keeps a session as read; of many, those read last. */
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

  private read(reading: JointReading): void {
    const begunOrEnded = reading.moving !== this.joints?.moving;
    this.joints = reading;
    this.dispatchEvent(new Event("joints"));
    if (begunOrEnded) this.changed();
  }

  private hear(status: StreamStatus): void {
    const reopened = status.open && !this.stream.open;
    this.stream = status;
    if (status.refused !== null && KEYLESS.has(status.refused)) this.keyNeeded = true;
    if (reopened) {
      this.refreshRig();
      for (const id of this.known.keys()) this.refreshSession(id);
    }
    this.changed();
  }

  /** Runs a reading now, or once more after the present one and a pause, however often it is asked for. */
  private paced(name: string, read: () => Promise<void>): void {
    if (this.due.has(name)) {
      this.again.add(name);
      return;
    }
    this.due.set(name, 1);
    void read()
      .catch((error: unknown) => {
        // Not reached: the age of the connection says so, and it is read again when it is back.
        if (error instanceof Refusal && KEYLESS.has(error.problem.status)) this.keyNeeded = true; // revoked meanwhile
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
    /** What the page knows, for whoever looks into it by the browser's console, and for tests. */
    lightpose: Live;
  }
}
window.lightpose = live;

/** Draws its element again when what the page knows changes; with `tick`, twice a second too. */
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

/** Tells its element each event of the journal while the element is in the document. */
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
