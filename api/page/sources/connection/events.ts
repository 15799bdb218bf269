/** Events of the service in this tab: from the browser's shared worker, or without one from the tab's own stream. */
import { storedKey } from "./credentials";
import { EventStream, type StreamListener, type StreamStatus } from "./event-stream";
import type { TabMessage } from "./event-worker";
import { abandonPictures } from "./pictures";
import type { JointReading, JournalEvent } from "./schemas";

type WorkerMessage =
  | { kind: "event"; event: JournalEvent }
  | { kind: "joints"; reading: JointReading }
  | { kind: "status"; status: StreamStatus }
  | { kind: "hurry" };

/** Time between two messages to the worker that the tab still exists, ms. */
const ALIVE_MS = 20_000;

let port: MessagePort | null = null;
let own: EventStream | null = null;
let timer = 0;

/** Follows the events with the present key. Call it again after a change of the key. */
export function follow(listener: StreamListener): void {
  own?.end();
  if (typeof SharedWorker === "undefined") {
    own = new EventStream(storedKey(), listener);
    return;
  }
  if (!port) {
    port = new SharedWorker("/page/event-worker.js", { name: "lightpose events" }).port;
    port.start();
    window.addEventListener("pagehide", () => tell({ kind: "close" }));
    window.addEventListener("pageshow", (event) => event.persisted && tell({ kind: "open", key: storedKey() }));
  }
  port.onmessage = ({ data }: MessageEvent<WorkerMessage>) => {
    if (data.kind === "event") listener.event(data.event);
    else if (data.kind === "joints") listener.joints(data.reading);
    else if (data.kind === "status") listener.status(data.status);
    else abandonPictures();
  };
  tell({ kind: "open", key: storedKey() });
  clearInterval(timer);
  timer = window.setInterval(() => tell({ kind: "alive" }), ALIVE_MS);
}

/** Releases the connections of this tab and of the others for a stop. */
export function hurry(): void {
  abandonPictures();
  tell({ kind: "hurry" });
}

function tell(message: TabMessage): void {
  port?.postMessage(message);
}
