/** What an element shows of a session, read from the API and read again when events say that there is more of it. */
import type { LitElement, ReactiveController } from "lit";
import { JournalController } from "./live";
import type { Session } from "./schemas";

/** Pause before what could not be read is asked for again, ms; the bar tells the age of the connection meanwhile. */
const RETRY_MS = 2_000;

/**
 * One reading at a time; what happens meanwhile is read after it, however many events tell of it. A reading that ends
 * after its element has been given another session is dropped.
 */
export class SessionReading<T> implements ReactiveController {
  private id = "";
  private reading = false;
  private again = false;
  private timer = 0;

  /** `events` are the types that call for a reading of an address, `take` is given what was read; null: forget it. */
  constructor(
    private readonly host: LitElement & { readonly session: Session },
    events: RegExp,
    private readonly read: (address: string) => Promise<T>,
    private readonly take: (found: T | null) => void,
  ) {
    host.addController(this);
    new JournalController(host, ({ type, session_id }) => {
      if (session_id === this.id && events.test(type)) void this.load();
    });
  }

  hostUpdate(): void {
    if (this.id === this.host.session.id) return;
    this.id = this.host.session.id;
    this.take(null);
    void this.load();
  }

  hostDisconnected(): void {
    clearTimeout(this.timer);
  }

  private async load(): Promise<void> {
    this.again = this.reading;
    if (this.reading) return;
    this.reading = true;
    clearTimeout(this.timer);
    const { id } = this;
    try {
      const found = await this.read(`/v1/sessions/${id}`);
      if (id === this.id) this.take(found);
    } catch {
      if (this.host.isConnected) this.timer = window.setTimeout(() => void this.load(), RETRY_MS);
    }
    this.reading = false;
    if (this.again) void this.load();
  }
}
