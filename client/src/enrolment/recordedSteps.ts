/**
 * The recordings of steps, kept in this browser (IndexedDB) until they are sent, so that a reload costs the step that was on
 * and no other. Each tab keeps its own; what was left behind goes at the next visit after a day.
 */

import type { RecordedClip } from "../capture/record";
import { zip } from "../capture/zip";
import type { Clip } from "./enrol";
import { passedSteps, resumeGuide, type GuideState } from "./guide";
import { STEPS, type StepName } from "./steps";

export interface StoredGuide {
  state: GuideState;
  recordings: Partial<Record<StepName, RecordedClip>>;
}

export interface GuideStore {
  /** What this tab kept; null: nothing, or the browser keeps nothing. */
  load(): Promise<StoredGuide | null>;
  /** Says whether it is kept. */
  save(guide: StoredGuide): Promise<boolean>;
  forget(): Promise<void>;
}

const DATABASE = "metanerf";
const STORE = "guides";
const TAB_KEY = "metanerf.guide";
const KEPT_MS = 24 * 3600 * 1000;
type Row = StoredGuide & { savedMs: number };

/** The clip of all passed steps, in their order: one recording, or an archive of several; null of none. */
export async function joined({ state, recordings }: StoredGuide): Promise<Clip | null> {
  const kept = passedSteps(state).flatMap((name) => {
    const recording = recordings[name];
    return recording ? [{ name, recording }] : [];
  });
  const [first] = kept;
  if (!first || kept.length === 1) return first?.recording ?? null;
  const entries = kept.map(({ name, recording }) => {
    const number = STEPS.findIndex((step) => step.name === name) + 1;
    return { name: `${number}-${name}.${recording.fileName.split(".").at(-1)}`, blob: recording.blob };
  });
  return { blob: await zip(entries), fileName: "webcam.zip", preview: first.recording.blob };
}

/** What was stored, where it can be gone on with: a step whose recording did not come through is to be done again. */
export function resumed({ state, recordings }: StoredGuide): StoredGuide {
  const isThere = ({ name }: { name: StepName }): boolean => state.outcomes[name] !== "passed" || !!recordings[name];
  const there = STEPS.filter(isThere).map(({ name }) => [name, state.outcomes[name]] as const);
  const outcomes = Object.fromEntries(there.filter(([, outcome]) => outcome)) as GuideState["outcomes"];
  return { state: resumeGuide({ ...state, outcomes }), recordings };
}

export const guideStore: GuideStore = {
  load: async () => {
    const tab = sessionStorage.getItem(TAB_KEY);
    try {
      await request("readwrite", (store) => removeOld(store));
      if (tab === null) return null;
      const row = await request<Row | undefined>("readonly", (store) => store.get(tab));
      return row ? resumed(row) : null;
    } catch {
      return null;
    }
  },
  save: async (guide) => {
    const tab = sessionStorage.getItem(TAB_KEY) ?? crypto.randomUUID();
    try {
      await request("readwrite", (store) => store.put({ ...guide, savedMs: Date.now() } satisfies Row, tab));
      sessionStorage.setItem(TAB_KEY, tab);
      return true;
    } catch {
      return false;
    }
  },
  forget: async () => {
    const tab = sessionStorage.getItem(TAB_KEY);
    if (tab === null) return;
    sessionStorage.removeItem(TAB_KEY);
    await request("readwrite", (store) => store.delete(tab)).catch(() => undefined);
  },
};

function removeOld(store: IDBObjectStore): IDBRequest {
  const walk = store.openCursor();
  walk.onsuccess = () => {
    const cursor = walk.result;
    if (!cursor) return;
    if (Date.now() - (cursor.value as Row).savedMs > KEPT_MS) cursor.delete();
    cursor.continue();
  };
  return walk;
}

/** What `ask` asks of the store, once the transaction is through. */
async function request<Of>(mode: IDBTransactionMode, ask: (store: IDBObjectStore) => IDBRequest): Promise<Of> {
  const database = await open();
  try {
    return await new Promise<Of>((resolve, reject) => {
      const transaction = database.transaction(STORE, mode);
      const asked = ask(transaction.objectStore(STORE));
      transaction.oncomplete = () => resolve(asked.result as Of);
      transaction.onerror = transaction.onabort = () => reject(transaction.error);
    });
  } finally {
    database.close();
  }
}

function open(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open(DATABASE, 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE);
    opening.onsuccess = () => resolve(opening.result);
    opening.onerror = () => reject(opening.error);
  });
}
