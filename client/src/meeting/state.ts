/** What this page knows of its meeting: a value that each message from the server makes anew. */

import type { Captioned, FromServer, Member, Reacted, RecordingUnderWay, Said } from "../api/types";

export type Reaction = Reacted["reaction"];

export interface MeetingState {
  /** Our own id; null until the server has greeted us. */
  me: string | null;
  /** Whoever comes waits until the host lets them in. */
  lobby: boolean;
  /** Name of the environment; empty until the server has sent it. */
  environment: string;
  /** Who may share a screen. */
  presenter: string | null;
  /** Who asks to, in their place; told to the host and to them. */
  presentRequestFrom: string | null;
  /** What was spoken last, in writing. */
  caption: Captioned | null;
  /** What is recorded, or is to be once everybody agrees. */
  recording: RecordingUnderWay | null;
  members: readonly Member[];
  /** Ids of the performers who are shown; null until the server has said. */
  performers: readonly string[] | null;
  messages: readonly Said[];
  /** Ids of those who speak now. */
  speaking: readonly string[];
  /** Who is heard in which track of the voice connection. */
  slots: readonly (string | null)[];
  /** Of the newest message; what comes after it is still to be told. */
  lastMessageNumber: number;
}

export const INITIAL_STATE: MeetingState = {
  me: null,
  lobby: false,
  environment: "",
  presenter: null,
  presentRequestFrom: null,
  caption: null,
  recording: null,
  members: [],
  performers: null,
  messages: [],
  speaking: [],
  slots: [],
  lastMessageNumber: 0,
};

const MAX_MESSAGES = 500;

export function applyMessage(state: MeetingState, message: FromServer): MeetingState {
  switch (message.type) {
    case "welcome":
      return { ...state, me: message.participant_id };
    case "roster":
      return {
        ...state,
        lobby: message.lobby,
        environment: message.environment,
        presenter: message.presenter_id,
        presentRequestFrom: message.presenter_asks_id,
        recording: message.recording,
        members: message.members,
        performers: message.performer_ids,
      };
    case "said":
      if (message.number <= state.lastMessageNumber) return state;
      return { ...state, messages: [...state.messages, message].slice(-MAX_MESSAGES), lastMessageNumber: message.number };
    case "captioned":
      return { ...state, caption: message, lastMessageNumber: Math.max(state.lastMessageNumber, message.number) };
    case "reacted":
      return { ...state, lastMessageNumber: Math.max(state.lastMessageNumber, message.number) };
    case "speaking":
      return { ...state, speaking: message.participant_ids, slots: message.slots };
    default:
      return state;
  }
}

/** Names of the others who speak now. */
export function activeSpeakers(state: MeetingState): string[] {
  const { members, speaking, me } = state;
  return members.filter(({ id }) => id !== me && speaking.includes(id)).map(({ name }) => name);
}

export function localParticipant(state: MeetingState): Member | null {
  return state.members.find(({ id }) => id === state.me) ?? null;
}

export function nameOf(state: MeetingState, id: string): string {
  return state.members.find((member) => member.id === id)?.name ?? "";
}

export function isHost(state: MeetingState): boolean {
  return localParticipant(state)?.role === "host";
}

/** Those who are in the meeting, the longest raised hands first. */
export function admittedMembers(state: MeetingState): Member[] {
  const members = state.members.filter(({ admission }) => admission === "admitted");
  const since = ({ hand_at }: Member): number => (hand_at === null ? Infinity : Date.parse(hand_at));
  return members
    .map((member, place) => ({ member, place }))
    .sort((a, b) => (since(a.member) === since(b.member) ? a.place - b.place : since(a.member) - since(b.member)))
    .map(({ member }) => member);
}

/** Those who wait to be let in; only the host is told of them. */
export function waitingMembers(state: MeetingState): Member[] {
  return state.members.filter(({ admission, id }) => admission === "waiting" && id !== state.me);
}

/** What is worth telling of a change, in words; nothing of oneself coming in. */
export function announcementsOf(before: MeetingState, after: MeetingState): string[] {
  // whoever is not in yet sees nobody else: that all are there then is no news
  if (localParticipant(before)?.admission !== "admitted" || before.members === after.members) return [];
  const was = new Map(before.members.map((member) => [member.id, member]));
  const is = new Map(after.members.map((member) => [member.id, member]));
  const news: string[] = [];
  for (const member of after.members) {
    news.push(...memberAnnouncements(was.get(member.id), member, member.id === after.me));
  }
  for (const { id, name, admission } of before.members) {
    if (!is.has(id) && admission === "admitted") news.push(`${name} left`);
  }
  return news;
}

function memberAnnouncements(was: Member | undefined, is: Member, mine: boolean): string[] {
  if (mine) return was && was.role !== is.role ? [MY_ROLE[is.role]] : [];
  if (!was) return [is.admission === "waiting" ? `${is.name} is asking to join` : `${is.name} joined`];
  const news: string[] = [];
  if (was.admission === "waiting" && is.admission === "admitted") news.push(`${is.name} joined`);
  if (was.hand_at === null && is.hand_at !== null) news.push(`${is.name} raised a hand`);
  if (was.present && !is.present) news.push(`${is.name} lost the connection`);
  if (!was.present && is.present) news.push(`${is.name} is back`);
  return news;
}

const MY_ROLE: Record<Member["role"], string> = {
  host: "You are now the host",
  speaker: "You can now speak and write",
  viewer: "You are now a viewer",
};
