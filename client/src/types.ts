/**
 * What travels as JSON between server and page. Written from the server's OpenAPI document by
 * `python -m services.client_types`; change services/api/shapes.py or services/control/messages.py
 * and run that, never this file.
 */

/** The host lets in somebody who waits. */
export interface Admit {
  type: "admit";
  participant_id: string;
}

/** A sign of life, each way, once a second. */
export interface Beat {
  type: "beat";
}

/** The demo's meeting. */
export interface DemoMeeting {
  meeting_id: string;
}

/** The host does not let in somebody who waits. */
export interface Deny {
  type: "deny";
  participant_id: string;
}

/** The host ends the meeting for everybody. */
export interface EndMeeting {
  type: "end";
}

/** A place to meet in. */
export interface Environment {
  name: string;
  /** For people to read. */
  title: string;
  /** Equirectangular JPEG, its middle towards +x; empty: the plain studio. */
  picture_url: string | null;
  /** Empty: everybody keeps the light they were filmed in. */
  light: Light | null;
}

/** The library. */
export interface Environments {
  items: Environment[];
}

/** The proof that a person is gone. */
export interface Erased {
  /** By table. */
  deleted_rows: Record<string, number>;
  deleted_objects: number;
  /** Rows and objects counted afterwards: 0. */
  remaining: number;
}

export type FromServer = Welcome | Beat | Roster | Said | Reacted | Speaking | Refusal | Goodbye;

/** The last message: why the channel ends. */
export interface Goodbye {
  type: "goodbye";
  reason: "left" | "given-back" | "denied" | "removed" | "ended" | "replaced" | "silent" | "refused";
  /** Where it was refused. */
  problem: Problem | null;
}

/** A token for the page. */
export interface Guest {
  token: string;
  expires_at: string;
}

/** The process lives. */
export interface Health {
  status?: "ok";
}

/** The first message of a page: whose seat it is. The same again takes the seat up again. */
export interface Hello {
  type: "hello";
  /** That of the seat. */
  token: string;
  name: string;
  /** Number of the newest message received. */
  after: number;
}

/** Long work and how far it is. */
export interface Job {
  id: string;
  kind: JobKind;
  state: JobState;
  /** 0 to 1. */
  progress: number;
  message: string;
  has_preview: boolean;
  sequence_id: string | null;
  model_id: string | null;
  error: Problem | null;
}

/** What a job does. */
export type JobKind = "capture" | "train";

/** Where a job stands. */
export type JobState = "queued" | "running" | "succeeded" | "failed" | "cancelled";

/** The same bytes are here already. */
export interface Known {
  sequence: Sequence;
}

/** Give the seat back. */
export interface Leave {
  type: "leave";
}

/** What falls on performers, linear RGB; 1 is what makes a white surface white. */
export interface Light {
  /** Irradiance over pi: coefficients of the 9 real spherical harmonics to order 2. */
  harmonics: (readonly [number, number, number])[];
  /** Unit, towards the light; world. */
  key_direction: readonly [number, number, number];
  key_colour: readonly [number, number, number];
}

/** A room and who stands in it. */
export interface Meeting {
  id: string;
  name: string;
  join_url: string;
  /** Name of the place it is held in. */
  environment: string;
  performers: Performer[];
  /** Whoever comes waits until the host lets them in. */
  lobby: boolean;
}

/** Somebody in the meeting, or waiting before it. */
export interface Member {
  id: string;
  name: string;
  role: Role;
  standing: Standing;
  /** False while their connection is lost. */
  present: boolean;
  /** Since when their hand is up. */
  hand_at: string | null;
  /** Whether they are to be heard. */
  microphone: boolean;
}

/** Be heard, or no longer. */
export interface Microphone {
  type: "microphone";
  on: boolean;
}

/** A trained model. */
export interface Model {
  id: string;
  person_id: string;
  sequence_id: string | null;
  preset: string;
  created_at: string;
  /** Of the weights. */
  bytes: number;
  /** Of the weights. */
  sha256: string;
  metrics: Record<string, unknown>;
  files: ModelFile[];
}

/** One file of a model. */
export interface ModelFile {
  name: string;
  bytes: number;
  url: string;
}

/** A list of models. */
export interface Models {
  items: Model[];
}

/** The host switches off somebody's microphone; they may switch it on again. */
export interface Mute {
  type: "mute";
  participant_id: string;
}

/** A room to open. */
export interface NewMeeting {
  name: string;
  model_ids?: string[];
  /** Whoever comes waits until the host lets them in. */
  lobby?: boolean;
}

/** What to train. */
export interface NewModel {
  preset?: string;
  /** Training time, s. */
  budget_s?: number;
  seed?: number;
}

/** Who comes in. */
export interface NewPerformer {
  model_id: string;
  /** Whose motion to follow; empty: the model's own. */
  motion_sequence_id?: string | null;
}

/** Somebody to enrol. */
export interface NewPerson {
  name: string;
}

/** A file that will come in pieces. */
export interface NewUpload {
  filename: string;
  /** Bytes. */
  size: number;
  /** Of the whole file, hex. */
  sha256: string;
}

/** A picture to render. */
export interface NewView {
  camera?: ViewCamera;
  width?: number;
  height?: number;
  /** Moment of the motion; empty: its start. */
  time_s?: number | null;
  pose?: ViewPose | null;
  /** Whose motion to follow; empty: the model's own. */
  motion_sequence_id?: string | null;
  /** sRGB; empty: transparent, white in a JPEG. */
  background?: readonly [number, number, number] | null;
  /** Show only what was filmed: the rest, filled in by guess, fades away. */
  hide_unseen?: boolean;
  format?: "png" | "jpeg" | "webp";
}

/** A new room, for whoever opened it. */
export interface OpenedMeeting {
  id: string;
  name: string;
  join_url: string;
  /** Name of the place it is held in. */
  environment: string;
  performers: Performer[];
  /** Whoever comes waits until the host lets them in. */
  lobby: boolean;
  /** Join with it to be the host; keep it to yourself. */
  host_token: string;
}

/** A camera on a sphere round the person. */
export interface Orbit {
  /** 0: in front of how they mostly face; 90: their left. */
  azimuth_deg?: number;
  elevation_deg?: number;
  /** Empty: so far that the whole person fits. */
  distance_m?: number | null;
}

/** A list of persons. */
export interface People {
  items: Person[];
}

/** A person's model standing in a meeting. */
export interface Performer {
  id: string;
  name: string;
  model_id: string;
  /** Empty: moves as they were filmed. */
  motion_sequence_id: string | null;
  /** World, m. */
  position: readonly [number, number, number];
  yaw_rad: number;
}

/** Somebody who is, or will be, met. */
export interface Person {
  id: string;
  name: string;
  created_at: string;
}

/** A person with all that was made of theirs. */
export interface PersonInFull {
  id: string;
  name: string;
  created_at: string;
  sequences: Sequence[];
  models: Model[];
}

/** Where a meeting is held. */
export interface Place {
  name: string;
}

/** What went wrong, for people and programs. */
export interface Problem {
  /** What kind of problem. */
  type: string;
  /** The kind in words. */
  title: string;
  /** The HTTP status. */
  status: number;
  /** The rule, the value received, how to mend it. */
  detail: string;
}

/** Ask to speak, or no longer. */
export interface RaiseHand {
  type: "hand";
  raised: boolean;
}

/** A passing sign to all. */
export interface React {
  type: "react";
  reaction: "applause" | "heart" | "laugh" | "surprise" | "agree" | "party";
}

/** Somebody gave a sign to all. */
export interface Reacted {
  type: "reacted";
  number: number;
  participant_id: string;
  name: string;
  reaction: "applause" | "heart" | "laugh" | "surprise" | "agree" | "party";
}

/** What the process needs, and whether it is there. */
export interface Readiness {
  status: "ready" | "unready";
  checks: Record<string, string>;
}

/** What was asked for was not done. */
export interface Refusal {
  type: "refusal";
  problem: Problem;
}

/** The host sends somebody out; from then on whoever comes has to wait. */
export interface Remove {
  type: "remove";
  participant_id: string;
}

/** What somebody may do in a meeting. */
export type Role = "host" | "speaker" | "viewer";

/** Who is there, whenever that changes; whoever waits sees only themselves. */
export interface Roster {
  type: "roster";
  /** Whoever comes waits until the host lets them in. */
  lobby: boolean;
  members: Member[];
}

/** Somebody wrote to all. */
export interface Said {
  type: "said";
  number: number;
  participant_id: string;
  name: string;
  text: string;
  at: string;
}

/** Write to all. */
export interface Say {
  type: "say";
  text: string;
}

/** A place in a meeting. */
export interface Seat {
  /** Opens this meeting's view and control channel, again after a reload as well. */
  token: string;
  participant_id: string;
  seat: number;
  role: Role;
  /** Whether the host has let you in; no view before that. */
  standing: Standing;
  ice_servers: string[];
  whep_url: string;
  control_url: string;
  /** False while the renderer compiles, on its first start on a machine. */
  ready: boolean;
  performers: Performer[];
}

/** A clip and how far it has come. */
export interface Sequence {
  id: string;
  person_id: string;
  kind: SequenceKind;
  state: SequenceState;
  created_at: string;
  /** Of the file that was uploaded. */
  sha256: string;
  frames: number | null;
  frames_per_second: number | null;
  duration_s: number | null;
  /** What capture says about the clip. */
  quality: Record<string, unknown> | null;
  thumbnail_url: string | null;
  /** Its capture. */
  job_id: string | null;
}

/** What was uploaded. */
export type SequenceKind = "video" | "frames" | "keypoints";

/** How far a sequence has come. */
export type SequenceState = "uploaded" | "capturing" | "ready";

/** The host has people wait, or lets everybody in. */
export interface SetLobby {
  type: "lobby";
  on: boolean;
}

/** The host makes somebody speaker, viewer, or host in their own place. */
export interface SetRole {
  type: "role";
  participant_id: string;
  role: Role;
}

/** Who speaks now, whenever that changes. */
export interface Speaking {
  type: "speaking";
  participant_ids: string[];
}

/** Whether somebody is let in. */
export type Standing = "waiting" | "admitted" | "denied" | "removed" | "ended";

export type ToServer = Hello | Beat | Say | React | RaiseHand | Microphone | Admit | Deny | Remove | Mute | SetRole | SetLobby | EndMeeting | Leave;

/** A file on its way. */
export interface Upload {
  id: string;
  /** Bytes that have come; go on from here. */
  offset: number;
}

/** Where to look from: an orbit, or a pinhole camera by its matrices (OpenCV axes). */
export interface ViewCamera {
  orbit?: Orbit | null;
  /** Vertical field of view. */
  fov_deg?: number;
  /** 3 x 3, px. */
  intrinsics?: number[][] | null;
  /** 3 x 4, m. */
  world_to_camera?: number[][] | null;
}

/** A pose of one's own. */
export interface ViewPose {
  /** 24 x 3, axis-angle, rad. */
  joint_angles: number[][];
  /** m */
  root_translation?: number[];
}

/** Who wants to look on. */
export interface Visitor {
  display_name?: string;
}

/** The answer to `hello`. */
export interface Welcome {
  type: "welcome";
  participant_id: string;
  seat: number;
  /** Either side silent for so long is gone, s. */
  silence_s: number;
}
