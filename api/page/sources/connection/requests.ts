/** Requests to the API with the caller's key. A refusal is thrown with its problem object. */
import { authorization, storedKey } from "./credentials";
import type { Page, Problem } from "./schemas";

/** Time limit of a request that needs no computation and no motion, ms. */
const TIMEOUT_MS = 15_000;

/** No time limit, for computations and motions: a busy machine is slow, and the bar shows if the service is gone. */
export const UNLIMITED = Infinity;

/** Statuses of a proxy whose service is gone or too slow. */
const GATEWAY = new Set([502, 503, 504]);

/** A refusal by the service, with its problem object. */
export class Refusal extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

/** The service was not reached, or did not answer in time. */
export class Unreachable extends Error {}

export interface RequestOptions {
  body?: unknown;
  headers?: Record<string, string>;
  timeoutMs?: number;
  signal?: AbortSignal;
}

/** Sends a request and returns its response. Throws Refusal or Unreachable; an abort by `signal` passes through. */
export async function send(method: string, address: string, options: RequestOptions = {}): Promise<Response> {
  const { timeoutMs = TIMEOUT_MS } = options;
  const limits = timeoutMs === UNLIMITED ? [] : [AbortSignal.timeout(timeoutMs)];
  if (options.signal) limits.push(options.signal);
  const binary = options.body instanceof Blob;
  const type = binary ? (options.body as Blob).type : "application/json";
  let response: Response;
  try {
    response = await fetch(address, {
      method,
      signal: AbortSignal.any(limits),
      headers: {
        ...authorization(storedKey()),
        ...(options.body === undefined ? {} : { "Content-Type": type }),
        ...options.headers,
      },
      ...(options.body === undefined ? {} : { body: binary ? (options.body as Blob) : JSON.stringify(options.body) }),
    });
  } catch (error) {
    if (options.signal?.aborted) throw error;
    throw new Unreachable(`${method} ${address}`, { cause: error });
  }
  if (!response.ok) {
    const problem = await problemOf(response);
    if (!problem) throw new Unreachable(`${method} ${address}: HTTP ${response.status}`);
    throw new Refusal(problem);
  }
  return response;
}

export async function get<T>(address: string, options: RequestOptions = {}): Promise<T> {
  return (await (await send("GET", address, options)).json()) as T;
}

export async function post<T>(address: string, body?: unknown, options: RequestOptions = {}): Promise<T> {
  return (await (await send("POST", address, { ...options, body })).json()) as T;
}

/** Returns all items of a list, page by page. */
export async function all<T>(address: string): Promise<T[]> {
  const items: T[] = [];
  for (let next: string | null = address; next !== null;) {
    const page: Page<T> = await get<Page<T>>(next);
    items.push(...page.items);
    next = page.next;
  }
  return items;
}

/** Returns an address that the browser opens itself (a download, a report), with a ticket if keys are in use. */
export async function openable(address: string): Promise<string> {
  if (!storedKey()) return address;
  const { ticket } = await post<{ ticket: string }>("/v1/tickets");
  return `${address}${address.includes("?") ? "&" : "?"}ticket=${encodeURIComponent(ticket)}`;
}

/** Returns the service's problem object; null if a proxy reports that it does not reach the service. */
async function problemOf(response: Response): Promise<Problem | null> {
  try {
    return (await response.json()) as Problem;
  } catch {
    if (GATEWAY.has(response.status)) return null;
    const title = `HTTP ${response.status}`;
    return { code: "service.fault", title, detail: response.statusText, remedy: "", status: response.status };
  }
}
