/** Stand-ins for what only a browser or a server has. */

import type { TokenStore } from "../src/api/tokenStore";
import { Sha256 } from "../src/api/sha256";
import type { Job, Member, Sequence } from "../src/api/types";
import type { HashedClip } from "../src/api/upload";

/** Of whoever has signed in by the name `account`, if by any. */
export function tokenStore(token: string | null, account: string | null = null): TokenStore {
  const hosts = new Map<string, string>();
  return {
    get: () => token,
    set: (next) => {
      token = next;
    },
    account: () => account,
    signIn: (next, name) => void ([token, account] = [next, name]),
    signOut: () => void (token = account = null),
    getHost: (id) => hosts.get(id) ?? null,
    setHost: (id, host) => void hosts.set(id, host),
  };
}

export function json(body: unknown, status = 200): Response {
  return new Response(JSON.stringify(body), { status });
}

export function eventStream(...jobs: Job[]): Response {
  const text = jobs.map((job) => `event: progress\ndata: ${JSON.stringify(job)}\n\n`).join("");
  const last = jobs.at(-1);
  return new Response(text + (last?.state === "running" ? "" : "event: end\ndata: {}\n\n"));
}

export function job(part: Partial<Job> = {}): Job {
  return {
    id: "j",
    kind: "train",
    state: "running",
    progress: 0,
    message: "",
    has_preview: false,
    retry_at: null,
    sequence_id: "s",
    model_id: null,
    error: null,
    ...part,
  };
}

export function sequence(part: Partial<Sequence> = {}): Sequence {
  return {
    id: "s",
    person_id: "p",
    kind: "video",
    state: "ready",
    created_at: "2026-01-01T00:00:00Z",
    sha256: "0".repeat(64),
    frames: 60,
    frames_per_second: 30,
    duration_s: 2,
    quality: null,
    thumbnail_url: null,
    job_id: null,
    ...part,
  };
}

export function member(part: Partial<Member> & { id: string }): Member {
  return { name: part.id, role: "speaker", admission: "admitted", present: true, hand_at: null, microphone: false, performer_id: null, connection: null, ...part };
}

/** As `Api.hashClip`, without a worker. */
export async function hashClip(blob: Blob, fileName: string): Promise<HashedClip> {
  return { blob, fileName, sha256: await sha256(blob) };
}

export async function sha256(blob: Blob): Promise<string> {
  const hash = new Sha256();
  hash.add(new Uint8Array(await blob.arrayBuffer()));
  return hash.hex();
}

export interface Call {
  method: string;
  path: string;
  token: string | null;
  body: string | null;
}

/** A fetch that answers from `answer` and keeps what was asked. */
export function fakeFetch(answer: (call: Call) => Response | Promise<Response>): {
  request: typeof fetch;
  calls: Call[];
} {
  const calls: Call[] = [];
  const request: typeof fetch = async (input, init) => {
    const headers = new Headers(init?.headers);
    const call = {
      method: init?.method ?? "GET",
      path: String(input),
      token: headers.get("Authorization"),
      body: typeof init?.body === "string" ? init.body : null,
    };
    calls.push(call);
    return answer(call);
  };
  return { request, calls };
}
