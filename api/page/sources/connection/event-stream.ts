/**
 * One stream of the service's events, and the pulse that checks whether the service answers.
 *
 * The stream is read with `fetch` instead of `EventSource`. It sends the key as a header, resumes by `Last-Event-ID`
 * from any id, and receives the keep-alive comments, so that a silently dead connection is noticed. The pulse is a
 * separate request, because a stream may stay open over a network that transmits nothing any more.
 */
import { authorization } from "./credentials";
import type { JointReading, JournalEvent } from "./schemas";

/** Time between two pulses, ms. */
const PULSE_MS = 1_000;
/** Time limit of a pulse, ms. */
const PULSE_TIMEOUT_MS = 1_500;
/** Time without data after which a stream is dead, ms. The service sends at least a comment every 10 s. */
const SILENCE_MS = 13_000;
/** Pause before the stream is opened again, ms. */
const RETRY_MS = 500;

/** Type of the readings of the arm's joints, which are not journalled and have no id. */
const JOINTS = "arm.joints";

/** Pause after a refusal, ms; it is longer, so that a revoked key is not tried all the time. */
const REFUSED_MS = 10_000;

export interface StreamStatus {
  /** Whether events flow. */
  open: boolean;
  /** When the service was last heard, ms since 1970; 0: never. */
  heardAt: number;
  /** Duration of the last answered pulse, ms. */
  roundTripMs: number | null;
  /** HTTP status of a refusal of the stream, such as 401. */
  refused: number | null;
}

export interface StreamListener {
  event(event: JournalEvent): void;
  joints(reading: JointReading): void;
  status(status: StreamStatus): void;
}

export class EventStream {
  status: StreamStatus = { open: false, heardAt: 0, roundTripMs: null, refused: null };
  private lastId: string | null = null;
  private ended = false;
  private reading: AbortController | null = null;
  private missedPulse = false;

  constructor(
    private readonly key: string,
    private readonly listener: StreamListener,
  ) {
    void this.read();
    void this.pulse();
  }

  end(): void {
    this.ended = true;
    this.reading?.abort();
  }

  private async read(): Promise<void> {
    while (!this.ended) {
      try {
        await this.readOnce();
      } catch {
        // The connection was cut or refused: the status shows it, and the loop opens the stream again.
      }
      this.update({ open: false });
      if (!this.ended) await pause(this.status.refused === null ? RETRY_MS : REFUSED_MS);
    }
  }

  private async readOnce(): Promise<void> {
    const abort = (this.reading = new AbortController());
    let silence = setTimeout(() => abort.abort(), SILENCE_MS);
    try {
      const resume: Record<string, string> = this.lastId === null ? {} : { "Last-Event-ID": this.lastId };
      const response = await fetch("/v1/events?joints=true", {
        headers: { ...authorization(this.key), ...resume },
        signal: abort.signal,
        cache: "no-store",
      });
      if (!response.ok || !response.body) {
        this.update({ refused: response.status < 500 ? response.status : null });
        return;
      }
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        clearTimeout(silence);
        silence = setTimeout(() => abort.abort(), SILENCE_MS);
        const blocks = (text + value).split("\n\n");
        text = blocks.pop() ?? "";
        for (const block of blocks) this.take(block);
        this.update({ open: true, heardAt: Date.now(), refused: null });
      }
    } finally {
      clearTimeout(silence);
      abort.abort();
    }
  }

  private take(block: string): void {
    const { id, type, data } = fieldsOf(block);
    this.lastId = id ?? this.lastId;
    if (!data) return;
    const body = JSON.parse(data) as unknown;
    if (type === JOINTS) this.listener.joints(body as JointReading);
    else this.listener.event(body as JournalEvent);
  }

  private async pulse(): Promise<void> {
    while (!this.ended) {
      const start = performance.now();
      try {
        const signal = AbortSignal.timeout(PULSE_TIMEOUT_MS);
        const response = await fetch("/health/live", { cache: "no-store", signal });
        if (!response.ok) throw new Error(`HTTP ${response.status}`); // a proxy answers instead of the service
        this.update({ heardAt: Date.now(), roundTripMs: Math.round(performance.now() - start) });
        // After a gap the old stream may hang on a dead connection. A new one replays the missed events.
        if (this.missedPulse) this.reading?.abort();
        this.missedPulse = false;
      } catch {
        this.missedPulse = true;
        this.update({ roundTripMs: null });
      }
      await pause(PULSE_MS);
    }
  }

  private update(change: Partial<StreamStatus>): void {
    if (this.ended) return; // an answer that was under way is about another key
    this.status = { ...this.status, ...change };
    this.listener.status(this.status);
  }
}

/** The fields of one message of a stream; `data` is empty if it holds only an id or a comment. */
export function fieldsOf(block: string): { id: string | null; type: string; data: string } {
  const fields = { id: null as string | null, type: "", data: "" };
  for (const line of block.split("\n")) {
    if (line.startsWith("id: ")) fields.id = line.slice(4);
    else if (line.startsWith("event: ")) fields.type = line.slice(7);
    else if (line.startsWith("data: ")) fields.data += line.slice(6);
  }
  return fields;
}

function pause(ms: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, ms));
}
