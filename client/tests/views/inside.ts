/** A participant's session in a meeting, and how tests find and press what the page shows of it. */

import { Api } from "../../src/api/api";
import type { Meeting, Roster, ToServer } from "../../src/api/types";
import type { ControlConnection, ControlHooks } from "../../src/meeting/controlConnection";
import { MeetingSession } from "../../src/meeting/session";
import { fakeFetch, json, member, tokenStore, type Call } from "../fakes";
import { FRONT } from "../viewpoint/front";

export const MEETING = { id: "m", name: "Monday", join_url: "/", performers: [], viewpoint: FRONT, lobby: false } as unknown as Meeting;
export const HOST = member({ id: "me", role: "host", microphone: true });
export const BO = member({ id: "b", name: "Bo" });
export const ROSTER: Roster = {
  type: "roster",
  lobby: false,
  environment: "studio",
  presenter_id: null,
  presenter_asks_id: null,
  recording: null,
  members: [HOST, BO],
  performer_ids: [],
};

/** Somebody in a meeting: `hear` is what the server says, `sent` what it is asked for. */
export function inside(answer: (call: Call) => Response = () => json({})) {
  const { request, calls } = fakeFetch((call) =>
    call.path.endsWith("/join") ? json({ token: "seat", gateway_url: "" }) : answer(call),
  );
  const api = new Api(tokenStore("guest"), request);
  const sent: ToServer[] = [];
  let hooks: ControlHooks | null = null;
  const line = { run: async () => undefined, send: (message: ToServer) => sent.push(message) > 0, close: () => undefined };
  const session = new MeetingSession(api, MEETING, { get: () => null, set: () => undefined }, (given) => {
    hooks = given;
    return line as unknown as ControlConnection;
  });
  session.join("Ada");
  const { onMessage } = hooks as unknown as ControlHooks;
  onMessage({ type: "welcome", participant_id: "me", seat: 1, silence_s: 5 });
  onMessage(ROSTER);
  const roster = (part: Partial<Roster>): void => onMessage({ ...ROSTER, ...part });
  return { api, session, calls, sent, hear: onMessage, state: (hooks as unknown as ControlHooks).onState, roster };
}

export function find<Kind extends Element>(within: Element, testId: string): Kind {
  const found = within.querySelector<Kind>(`[data-testid="${testId}"]`);
  if (!found) throw new Error(`${testId} is not there`);
  return found;
}

/** As a click of the mouse does. */
export function press(within: Element, testId: string): void {
  find<HTMLElement>(within, testId).click();
}
