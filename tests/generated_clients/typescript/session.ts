/** A whole session by openapi-fetch with the types of openapi-typescript: `node session.js URL MASK.png FOLDER`. */

import { readFileSync, writeFileSync } from "node:fs";

import createClient from "openapi-fetch";

import type { components, paths } from "./lightpose.d.ts";

type EventResource = components["schemas"]["EventResource"];

const ENDED = ["completed", "stopped", "failed", "interrupted"];

/** The value of an answer; throws where it is a problem. */
function given<T>(answer: { data?: T; error?: unknown }): T {
  if (answer.data === undefined) throw new Error(JSON.stringify(answer.error));
  return answer.data;
}

/** Events of a stream as they arrive. */
async function* events(stream: ReadableStream<Uint8Array>): AsyncGenerator<EventResource> {
  const decoder = new TextDecoder();
  let rest = "";
  for await (const block of stream) {
    const parts = (rest + decoder.decode(block, { stream: true })).split("\n\n");
    rest = parts.pop() ?? "";
    for (const part of parts) {
      const line = part.split("\n").find((item) => item.startsWith("data: "));
      if (line !== undefined) yield JSON.parse(line.slice(6)) as EventResource;
    }
  }
}

const [url, mask, folder] = process.argv.slice(2) as [string, string, string];
const client = createClient<paths>({ baseUrl: url });
const rig = given(await client.GET("/v1/rig"));
const order = {
  body: { label: "generated", pilot_lights: 4, planned_lights: 3, seed: 1 } as components["schemas"]["Recipe"],
  params: { header: { "idempotency-key": "typescript-1" } },
};
const session = given(await client.POST("/v1/sessions", order));
const again = given(await client.POST("/v1/sessions", order));
const path = { session_id: session.id };
const region = given(
  await client.PUT("/v1/sessions/{session_id}/region.png", {
    params: { path },
    headers: { "Content-Type": "image/png" },
    body: "",
    bodySerializer: () => readFileSync(mask),
  }),
);
const stream = given(
  await client.GET("/v1/events", { params: { query: { session_id: session.id, after: 0 } }, parseAs: "stream" }),
);
given(await client.POST("/v1/sessions/{session_id}/actions", { params: { path }, body: { action: "start" } as components["schemas"]["ActionRequest"] }));

const heard: EventResource[] = [];
for await (const event of events(stream as ReadableStream<Uint8Array>)) {
  heard.push(event);
  if (event.type === "session.state" && ENDED.includes(String(event.body["state"]))) break;
}

const done = given(await client.GET("/v1/sessions/{session_id}", { params: { path } }));
if (done.answer === null) throw new Error("no answer");
const normals = given(
  await client.GET("/v1/sessions/{session_id}/results/{number}/{artefact}", {
    params: { path: { ...path, number: done.answer.number, artefact: "normals.png" } },
    parseAs: "arrayBuffer",
  }),
);
writeFileSync(`${folder}/normals.png`, Buffer.from(normals as ArrayBuffer));
const image = given(
  await client.GET("/v1/sessions/{session_id}/passes/{number}/shots/{shot_number}/image", {
    params: { path: { ...path, number: 0, shot_number: 0 } },
    parseAs: "arrayBuffer",
  }),
);
writeFileSync(`${folder}/image.png`, Buffer.from(image as ArrayBuffer));
const missing = await client.GET("/v1/sessions/{session_id}", { params: { path: { session_id: "no-such-session" } } });

console.log(
  JSON.stringify({
    may_start: rig.may_start,
    same: again.id === session.id,
    region_pixels: region.pixels,
    event_ids: heard.map((event) => event.id),
    event_types: [...new Set(heard.map((event) => event.type))],
    state: done.state,
    sigma_deg: done.answer.summary.mean_sigma_deg,
    missing: missing.error?.code ?? "no problem",
  }),
);
process.exit(0);
