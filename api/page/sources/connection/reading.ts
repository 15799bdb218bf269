/**
 * Data that an element shows, read from the API. It is read again after a failure, on events that change it, and when
 * the connection is back. The element shows which of these is the case (`parts/reading-state`).
 *
 * There is one reading at a time. Events that arrive meanwhile cause one further reading, however many they are.
 */
import type { LitElement, ReactiveController } from "lit";
import { live } from "./live";
import type { JournalEvent, Session } from "./schemas";

/** Pause before a failed reading is repeated, ms. */
export const RETRY_MS = 2_000;

export interface ReadingOptions {
  /** Whether an event calls for another reading. */
  again?: (event: JournalEvent) => boolean;
  /** Subject of the reading. When it changes, the data are forgotten and a reading under way is dropped. */
  of?: () => string;
  /** Not read again when the connection is back, because a person works on the data. */
  once?: boolean;
}

/** The options of a reading about an element's session: it is read again on its events of these types. */
export function ofSession(host: { readonly session: Session }, types: RegExp): ReadingOptions {
  return {
    of: () => host.session.id,
    again: ({ type, session_id }) => session_id === host.session.id && types.test(type),
  };
}

export class Reading<T> implements ReactiveController {
  /** The data read last; null: none yet. */
  found: T | null = null;
  /** Error of the last reading; null: none. */
  failed: unknown = null;
  private reading = false;
  private repeat = false;
  private subject = "";
  private turn = 0;
  private timer = 0;

  constructor(
    private readonly host: LitElement,
    private readonly read: () => Promise<T>,
    private readonly options: ReadingOptions = {},
  ) {
    host.addController(this);
  }

  hostConnected(): void {
    live.addEventListener("journal", this.hear);
    live.addEventListener("reopened", this.reopened);
    if (!this.followed()) void this.load();
  }

  hostUpdate(): void {
    this.followed();
  }

  hostDisconnected(): void {
    live.removeEventListener("journal", this.hear);
    live.removeEventListener("reopened", this.reopened);
    clearTimeout(this.timer);
  }

  /** Reads now, or once more after the reading under way. */
  async load(): Promise<void> {
    this.repeat = this.reading;
    if (this.reading) return;
    this.reading = true;
    clearTimeout(this.timer);
    const { turn } = this;
    try {
      const found = await this.read();
      if (turn === this.turn) [this.found, this.failed] = [found, null];
    } catch (error) {
      if (turn === this.turn) this.failed = error;
      if (this.host.isConnected) this.timer = window.setTimeout(() => void this.load(), RETRY_MS);
    }
    this.reading = false;
    this.host.requestUpdate();
    if (this.repeat) await this.load();
  }

  /** Starts over: the result of a reading under way is dropped. */
  restart(forget = true): void {
    this.turn += 1;
    if (forget) this.found = this.failed = null;
    void this.load();
  }

  /** Restarts if the subject has changed. Returns whether it has. */
  private followed(): boolean {
    const subject = this.options.of?.() ?? "";
    if (subject === this.subject) return false;
    this.subject = subject;
    this.restart();
    return true;
  }

  private readonly hear = (event: Event): void => {
    if (this.options.again?.((event as CustomEvent<JournalEvent>).detail)) void this.load();
  };

  private readonly reopened = (): void => {
    if (!this.options.once || this.found === null) void this.load();
  };
}
