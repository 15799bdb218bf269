/**
 * Shared worker: one event stream for all tabs of a browser that use the same key.
 *
 * HTTP/1.1 allows a browser six connections to one host. If every tab had its own stream, the stop of the third or
 * fourth tab could wait in the browser's queue.
 */
import { EventStream } from "./event-stream";

/** Messages of a tab to the worker. */
export type TabMessage = { kind: "open"; key: string } | { kind: "alive" } | { kind: "close" } | { kind: "hurry" };

/** Time of silence after which a tab is gone, ms; a worker is not notified when a tab crashes. */
const GONE_MS = 90_000;

interface Listening {
  stream: EventStream;
  ports: Map<MessagePort, number>;
}

const streams = new Map<string, Listening>();

function listeningTo(key: string): Listening {
  const known = streams.get(key);
  if (known) return known;
  const ports = new Map<MessagePort, number>();
  const tell = (message: unknown): void => ports.forEach((_, port) => port.postMessage(message));
  const stream = new EventStream(key, {
    event: (event) => tell({ kind: "event", event }),
    joints: (reading) => tell({ kind: "joints", reading }),
    status: (status) => tell({ kind: "status", status }),
  });
  const made = { stream, ports };
  streams.set(key, made);
  return made;
}

function leave(key: string, port: MessagePort): void {
  const listening = streams.get(key);
  listening?.ports.delete(port);
  if (listening?.ports.size === 0) {
    listening.stream.end();
    streams.delete(key);
  }
}

const scope = self as unknown as { onconnect: (event: MessageEvent) => void };
scope.onconnect = (connected) => {
  const port = connected.ports[0]!;
  let key: string | null = null;
  port.onmessage = ({ data }: MessageEvent<TabMessage>) => {
    if (data.kind === "open") {
      if (key !== null) leave(key, port);
      key = data.key;
      const listening = listeningTo(key);
      listening.ports.set(port, Date.now());
      port.postMessage({ kind: "status", status: listening.stream.status });
    } else if (key !== null && data.kind === "alive") {
      const listening = listeningTo(key);
      // A tab that was frozen has missed events. A status with a closed stream makes it read everything again.
      if (!listening.ports.has(port))
        for (const status of [{ ...listening.stream.status, open: false }, listening.stream.status])
          port.postMessage({ kind: "status", status });
      listening.ports.set(port, Date.now());
    } else if (key !== null && data.kind === "close") leave(key, port);
    else if (data.kind === "hurry") {
      // A stop is under way in one tab: the others release their connections.
      for (const { ports } of streams.values())
        ports.forEach((_, other) => other !== port && other.postMessage({ kind: "hurry" }));
    }
  };
};

setInterval(() => {
  for (const [key, { ports }] of streams)
    for (const [port, since] of ports) if (Date.now() - since > GONE_MS) leave(key, port);
}, GONE_MS / 3);
