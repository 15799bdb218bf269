/**
 * What an element shows, read from the API: read again when that failed, when events tell of more, and when the
 * connection is back. The element says which of it is the case (`parts/reading-state`).
 *
 * One reading at a time; what happens meanwhile is read after it, however many events tell of it.
 */
import type { LitElement, ReactiveController } from "lit";
import { live } from "./live";
import type { JournalEvent, Session } from "./schemas";

/** Pause before what could not be read is asked for again, ms. */
const RETRY_MS = 2_000;

export interface ReadingOptions {
  /** Events that call for another reading. */
  again?: (event: JournalEvent) => boolean;
  /** What is read about; of another one what was read is forgotten, what is being read dropped. */
  of?: () => string;
  /** Not read again when the connection is back: a person works on what was read. */
  once?: boolean;
}

/** The options of a reading about an element's session: read again on its events of these types. */
export function ofSession(host: { readonly session: Session }, types: RegExp): ReadingOptions {
  return {
    of: () => host.session.id,
    again: ({ type, session_id }) => session_id === host.session.id && types.test(type),
  };
}

export class Reading<T> implements ReactiveController {
  /** What was read last; null: nothing yet. */
  found: T | null = null;
  /** What the last reading failed with; null: it did not. */
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

  /** Reads now, or once more after the reading that is under way. */
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

  /** Reads something else: what a reading under way finds is dropped. */
  restart(forget = true): void {
    this.turn += 1;
    if (forget) this.found = this.failed = null;
    void this.load();
  }

  /** Restarts where there is another subject than before; whether there is. */
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
