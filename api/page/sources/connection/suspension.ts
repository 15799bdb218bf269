/** Why a session waited for a person before it was stopped: the session itself then states only that it is stopped. */
import { fieldsOf } from "./event-stream";
import { send } from "./requests";
import type { JournalEvent, Problem, Session } from "./schemas";

/** A state in which a session waits for a person, and the problem that brought it there. */
export interface Suspension {
  state: Session["state"];
  reason: Problem;
}

/** Reads in what state a session was stopped, and why; null if it did not wait because of a problem. */
export async function suspensionBeforeStop(id: string): Promise<Suspension | null> {
  const query = new URLSearchParams({ session_id: id, type: "session.state", after: "0", follow: "false" });
  const text = await (await send("GET", `/v1/events?${query}`)).text();
  const told = text.split("\n\n").map((block) => fieldsOf(block).data);
  const changes = told.filter(Boolean).map((data) => (JSON.parse(data) as JournalEvent).body as Partial<Suspension>);
  const before = changes.filter(({ state }) => state !== "stopping" && state !== "stopped").at(-1);
  // A plan that waits for review is no problem.
  if (!before?.state || !before.reason || before.reason.code === "plan.to_review") return null;
  return { state: before.state, reason: before.reason };
}
