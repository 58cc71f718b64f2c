/**
 * What travels as JSON between server and page. Written from the server's OpenAPI document by
 * `python -m tools.client_types`; change services/api/*shapes.py or
 * services/control/messages.py and run that, never this file.
 */

/** How this server lets people in who were not invited. */
export interface Access {
  guests: boolean;
  login: boolean;
}

/** Whether somebody is let into a meeting; with a lobby, the host decides. */
export type Admission = "waiting" | "admitted" | "denied" | "removed" | "ended";

/** The host admits a participant who waits in the lobby. */
export interface Admit {
  type: "admit";
  participant_id: string;
}

/** Agree to being recorded, refuse, or withdraw; the last two end the recording. */
export interface Agree {
  type: "agree";
  on: boolean;
}

/** A heartbeat, sent by both sides once a second. */
export interface Beat {
  type: "beat";
}

/** Where the camera is at a moment; between stops it moves evenly. */
export interface CameraStop {
  at_s: number;
  /** Room, m. */
  position: readonly [number, number, number];
  /** What it looks at, m. */
  target: readonly [number, number, number];
}

/** A caption of what one has just said. */
export interface Caption {
  type: "caption";
  text: string;
}

/** A caption of what a participant said, from their own page. */
export interface Captioned {
  type: "captioned";
  number: number;
  participant_id: string;
  name: string;
  text: string;
}

/** How well somebody's network carries the meeting. */
export type Connection = "good" | "fair" | "poor";

/** What somebody's model may be used for, and whether that holds now. */
export interface Consent {
  purposes: Purpose[];
  /** Empty: no end is set. */
  until: string | null;
  /** Only while it is given, the model is shown, recorded or driven by others. */
  state: ConsentState;
  revoked_at: string | null;
}

/** Whether a consent holds. */
export type ConsentState = "given" | "ended" | "revoked";

/** The demo's meeting, where the server shows one. */
export interface DemoMeeting {
  /** Empty: this server runs no demo. */
  meeting_id: string | null;
}

/** The host denies admission to a participant who waits in the lobby. */
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

/** The same bytes were uploaded before: the sequence that was made of them. */
export interface ExistingSequence {
  sequence: Sequence;
}

export type FromServer = Welcome | Beat | Roster | Said | Reacted | Captioned | Speaking | Refusal | Goodbye;

/** The last message: why the channel is closed. */
export interface Goodbye {
  type: "goodbye";
  reason: "left" | "given-back" | "denied" | "removed" | "ended" | "replaced" | "silent" | "refused" | "moved";
  /** Why `hello` was refused; empty for other reasons. */
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

/** The first message of a page: which seat it uses. A later connection sends it again. */
export interface Hello {
  type: "hello";
  /** The token of the seat, as joining gave it. */
  token: string;
  name: string;
  /** Number of the newest message received; newer ones are sent. */
  after: number;
}

/** An entry of `RTCConfiguration.iceServers`. */
export interface IceServer {
  urls: string[];
  username?: string;
  credential?: string;
}

/** How others come to a meeting. */
export interface Invitation {
  /** The link to send; it lasts for a week. */
  join_url: string;
}

/** A capture, training or export, and its progress. */
export interface Job {
  id: string;
  kind: JobKind;
  state: JobState;
  /** 0 to 1. */
  progress: number;
  message: string;
  has_preview: boolean;
  sequence_id: string | null;
  /** What was trained; until the job ends, the best there is so far: while its clip is being captured, a first likeness. */
  model_id: string | null;
  /** Why it failed; of a queued job, why it waits for room on a full disk. */
  error: Problem | null;
  /** When a job that waits for room is tried again, if nobody resumes it before. */
  retry_at: string | null;
}

/** What a job does. */
export type JobKind = "capture" | "train" | "export";

/** Where a job stands. */
export type JobState = "queued" | "running" | "succeeded" | "failed" | "cancelled";

/** Whether pictures of live look are to be kept. */
export interface KeepFrames {
  on: boolean;
}

/** One picture that is kept. */
export interface KeptFrame {
  /** A small PNG, as a data URL. */
  picture: string;
  /** That the model had not seen, in words. */
  sides: string[];
}

/** Pictures of live look that are kept until their owner says what becomes of them. */
export interface KeptFrames {
  on: boolean;
  frames: KeptFrame[];
}

/** Leave the meeting and release the seat. */
export interface Leave {
  type: "leave";
}

/** The host lets a participant share their screen in place of the presenter, or stops it. */
export interface LetPresent {
  type: "let-present";
  participant_id: string;
  on: boolean;
}

/** What falls on performers, linear RGB; 1 is what makes a white surface white. */
export interface Light {
  /** Irradiance over pi: coefficients of the 9 real spherical harmonics to order 2. */
  harmonics: (readonly [number, number, number])[];
  /** Unit, towards the light; world. */
  key_direction: readonly [number, number, number];
  key_colour: readonly [number, number, number];
}

/** A person of the token's account, or one of the demo that every guest may use. */
export interface ListedPerson {
  id: string;
  name: string;
  created_at: string;
  /** Barefoot, as it was given when the person was made. */
  height_m: number | null;
  consent: Consent;
  /** Whether the token's account owns them, and may change and erase them. */
  mine: boolean;
}

/** A token for the page of somebody who has logged in. */
export interface LoggedIn {
  token: string;
  expires_at: string;
  name: string;
}

/** A meeting and the performers who are shown in it. */
export interface Meeting {
  id: string;
  name: string;
  join_url: string;
  /** Name of the place it is held in. */
  environment: string;
  performers: Performer[];
  /** From where the caller looks at first. */
  viewpoint: Viewpoint;
  /** Whoever joins waits until the host admits them. */
  lobby: boolean;
  /** Motion travels end-to-end encrypted. */
  sealed: boolean;
  /** Whoever joins is asked to agree to being recorded. */
  recording?: boolean;
}

/** Where the voices and pictures of a meeting are. */
export interface MeetingHome {
  /** As in `Seat`. */
  gateway_url: string;
}

/** A participant in the meeting or in its lobby. */
export interface Member {
  id: string;
  name: string;
  role: Role;
  admission: Admission;
  /** False while their connection is lost. */
  present: boolean;
  /** Since when their hand is raised; empty: it is not. */
  hand_at: string | null;
  /** Whether their microphone is on. */
  microphone: boolean;
  /** Quality of their network connection; empty: unknown. */
  connection: Connection | null;
  /** The performer that represents them, from whose position their voice is heard. */
  performer_id: string | null;
}

/** Switch one's microphone on or off. */
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

/** The host switches off a participant's microphone; they may switch it on again. */
export interface Mute {
  type: "mute";
  participant_id: string;
}

/** The quality of one's network connection, whenever it changes. */
export interface Network {
  type: "network";
  connection: Connection;
}

/** What somebody's model may be used for, and until when. */
export interface NewConsent {
  /** `meetings`: it is shown in meetings. `recordings`: recordings hold what they move, say and write, once they agreed to each. `driving`: others in a meeting may drive it, not the owner alone. `learning`: it learns from pictures of live look that the owner kept. Empty: nobody but the owner sees it. */
  purposes: Purpose[];
  /** From then on it holds no longer; empty: no end is set. */
  until?: string | null;
}

/** A meeting to open. */
export interface NewMeeting {
  name: string;
  model_ids?: string[];
  /** Whoever joins waits until the host admits them. */
  lobby?: boolean;
  /** Motion travels end-to-end encrypted, by a key that pages put into the link and this server never gets: it neither draws nor records the meeting. */
  sealed?: boolean;
}

/** What to train. */
export interface NewModel {
  preset?: string;
  /** Training time, s. */
  budget_s?: number;
  seed?: number;
  /** A model of the same person to go on from (splats); the new one takes its place, in meetings too. */
  improves?: string | null;
  /** Delete the clip, its frames and its pictures once the model is trained. */
  model_only?: boolean;
}

/** A model that is to perform in a meeting. */
export interface NewPerformer {
  model_id: string;
  /** The sequence whose motion it follows; empty: the model's own. */
  motion_sequence_id?: string | null;
}

/** Somebody to enrol. */
export interface NewPerson {
  name: string;
  /** Barefoot; empty: guessed from each clip, and with it their size. */
  height_m?: number | null;
  /** What their model may be used for, and until when. */
  consent?: NewConsent;
}

/** A file that will be sent in pieces. */
export interface NewUpload {
  filename: string;
  /** Bytes. */
  size: number;
  /** Of the whole file, hex. */
  sha256: string;
}

/** How a recording is to be filmed. */
export interface NewVideo {
  /** Empty: once round everybody. */
  path?: CameraStop[];
  width?: number;
  height?: number;
  /** Vertical field of view. */
  fov_deg?: number;
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
  /** Parts of the body that were never filmed, as legs under a desk, fade out; else they are shown as they are guessed. */
  hide_unseen?: boolean;
  /** What pixels tell: colour; depth along the camera's axis, 16 bits, mm, 0 where nobody is; or the surface's normal, xyz from -1 to 1 in the world's axes as 8 bits. */
  shows?: "colour" | "depth" | "normal";
  format?: "png" | "jpeg" | "webp";
}

/** A new meeting, as its creator sees it. */
export interface OpenedMeeting {
  id: string;
  name: string;
  join_url: string;
  /** Name of the place it is held in. */
  environment: string;
  performers: Performer[];
  /** From where the caller looks at first. */
  viewpoint: Viewpoint;
  /** Whoever joins waits until the host admits them. */
  lobby: boolean;
  /** Motion travels end-to-end encrypted. */
  sealed: boolean;
  /** Whoever joins is asked to agree to being recorded. */
  recording?: boolean;
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
  items: ListedPerson[];
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
  /** Turn of the model about +y. */
  yaw_rad: number;
  /** Whose person it is: the caller's own, the demo's, or somebody else's. */
  owner: "own" | "demo" | "other";
  /** Whether the caller may drive them: their own, and whose person consents to being driven by others. */
  drivable: boolean;
  /** In front of them. */
  viewpoint: Viewpoint;
}

/** A person who is, or will be, modelled. */
export interface Person {
  id: string;
  name: string;
  created_at: string;
  /** Barefoot, as it was given when the person was made. */
  height_m: number | null;
  consent: Consent;
}

/** A person with all that was made of theirs. */
export interface PersonInFull {
  id: string;
  name: string;
  created_at: string;
  /** Barefoot, as it was given when the person was made. */
  height_m: number | null;
  consent: Consent;
  sequences: Sequence[];
  models: Model[];
}

/** Where a meeting is held. */
export interface Place {
  name: string;
}

/** Start or stop sharing a screen. While somebody else shares, the host is asked. */
export interface Present {
  type: "present";
  on: boolean;
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

/** What a person's model may be used for, beside its owner's own pictures of it. */
export type Purpose = "meetings" | "recordings" | "driving" | "learning";

/** Raise or lower one's hand. */
export interface RaiseHand {
  type: "hand";
  raised: boolean;
}

/** Send a reaction to all participants; it is shown for a moment. */
export interface React {
  type: "react";
  reaction: "applause" | "heart" | "laugh" | "surprise" | "agree" | "party";
}

/** A reaction of a participant. */
export interface Reacted {
  type: "reacted";
  number: number;
  participant_id: string;
  name: string;
  reaction: "applause" | "heart" | "laugh" | "surprise" | "agree" | "party";
}

/** What the process needs, and whether it is there. */
export interface Readiness {
  /** Degraded: it serves, without what it can do without. */
  status: "ready" | "degraded" | "unready";
  checks: Record<string, string>;
}

/** The host asks everybody whether the meeting may be recorded, or ends the recording. */
export interface RecordMeeting {
  type: "record";
  on: boolean;
}

/** Somebody who agreed to be recorded. */
export interface RecordedMember {
  participant_id: string;
  name: string;
  /** Who stood for them. */
  performer_id: string | null;
}

/** What one moved, said or wrote. */
export interface RecordedTrack {
  /** `room`, `motion:ID`, `voice:ID` or `chat:ID`. */
  name: string;
  /** As kept; more when fetched. */
  bytes: number;
  url: string;
}

/** A video that was made of a recording. */
export interface RecordedVideo {
  job_id: string;
  bytes: number;
  url: string;
}

/** A meeting that was, or is being, recorded. */
export interface Recording {
  id: string;
  meeting_id: string;
  name: string;
  state: RecordingState;
  asked_at: string;
  ended_at: string | null;
  why_ended: string | null;
  duration_s: number;
  bytes: number;
  /** Whether the token's account asked for it, and may delete it. */
  mine: boolean;
  members: RecordedMember[];
}

/** A recording with what it holds. */
export interface RecordingInFull {
  id: string;
  meeting_id: string;
  name: string;
  state: RecordingState;
  asked_at: string;
  ended_at: string | null;
  why_ended: string | null;
  duration_s: number;
  bytes: number;
  /** Whether the token's account asked for it, and may delete it. */
  mine: boolean;
  members: RecordedMember[];
  tracks: RecordedTrack[];
  videos: RecordedVideo[];
}

/** How far a recording has come. */
export type RecordingState = "asking" | "running" | "ended";

/** A recording that was asked for or is running. */
export interface RecordingUnderWay {
  id: string;
  /** Everybody present has agreed, and the meeting is being recorded. */
  running: boolean;
  /** Ids of the participants who have agreed. */
  agreed: string[];
}

/** A list of recordings. */
export interface Recordings {
  items: Recording[];
}

/** A command that was refused. */
export interface Refusal {
  type: "refusal";
  problem: Problem;
}

/** The host removes a participant; from then on the lobby is on. */
export interface Remove {
  type: "remove";
  participant_id: string;
}

/** What was taken out of a recording. */
export interface RemovedFromRecording {
  chunks: number;
  videos: number;
}

/** What somebody may do in a meeting. */
export type Role = "host" | "speaker" | "viewer";

/** The participants, whenever they change; one in the lobby sees only themselves. */
export interface Roster {
  type: "roster";
  /** Whoever joins waits until the host admits them. */
  lobby: boolean;
  /** Name of the environment that the meeting is held in. */
  environment: string;
  /** The participant who may share a screen; empty: nobody. */
  presenter_id: string | null;
  /** The participant who asks to present instead; only the host and they see it. */
  presenter_asks_id: string | null;
  /** Empty: the meeting is not recorded, and nobody has asked to. */
  recording: RecordingUnderWay | null;
  members: Member[];
  /** Of the performers who are shown, in the order of their poses: whoever is drawn and is not among them is to be drawn no longer. */
  performer_ids: string[];
}

/** A chat message of a participant. */
export interface Said {
  type: "said";
  number: number;
  participant_id: string;
  name: string;
  text: string;
  at: string;
}

/** Send a chat message to all participants. */
export interface Say {
  type: "say";
  text: string;
}

/** A seat in a meeting, and the token that it is used with. */
export interface Seat {
  /** Opens this meeting's view and control channel, also after a reload. */
  token: string;
  participant_id: string;
  seat: number;
  role: Role;
  /** Whether the host has admitted you; there is no view before that. */
  admission: Admission;
  /** For RTCConfiguration; credentials of TURN last as long as the token. */
  ice_servers: IceServer[];
  /** Address of the gateway that the meeting lives on; empty: whichever you ask. Your view and your control channel are there, and after a loss may be elsewhere. */
  gateway_url: string;
  whep_url: string;
  control_url: string;
  /** False while the renderer compiles, on its first start on a machine. */
  ready: boolean;
  performers: Performer[];
  /** From where you look at first. */
  viewpoint: Viewpoint;
}

/** A clip, and the state of its processing. */
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
export type SequenceKind = "video" | "frames" | "keypoints" | "live";

/** How far a sequence has come. */
export type SequenceState = "uploaded" | "capturing" | "ready" | "forgotten";

/** The host switches the lobby on or off; off admits everybody who waits. */
export interface SetLobby {
  type: "lobby";
  on: boolean;
}

/** The host gives a participant a role; a new host takes the place of the old one. */
export interface SetRole {
  type: "role";
  participant_id: string;
  role: Role;
}

/** Who is speaking and in which track each is heard, whenever that changes. */
export interface Speaking {
  type: "speaking";
  participant_ids: string[];
  /** By track of the voice connection: the participant whose voice it carries. */
  slots: (string | null)[];
}

export type ToServer = Hello | Beat | Say | React | RaiseHand | Microphone | Caption | Present | Network | Admit | Deny | Remove | Mute | SetRole | SetLobby | LetPresent | EndMeeting | RecordMeeting | Agree | Leave;

/** An upload that is under way. */
export interface Upload {
  id: string;
  /** Bytes received so far; the next piece begins here. */
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
  /** Face, hands. */
  expression?: number[];
}

/** From where one looks at first: an orbit round a target. */
export interface Viewpoint {
  /** World, m. */
  target: readonly [number, number, number];
  /** 0 looks from +z, +pi/2 from +x. */
  azimuth_rad: number;
  /** Positive above the target. */
  elevation_rad: number;
  /** From the target; more where the width needs it. */
  distance_m: number;
  /** What is to be in sight at the target. */
  width_m: number;
  /** How far behind the target the last performer is. */
  depth_m: number;
  /** What a picture shows instead that would have to step back for the width. */
  narrow: Viewpoint | null;
}

/** Somebody who wants to join. */
export interface Visitor {
  display_name?: string;
}

/** The answer to `hello`. */
export interface Welcome {
  type: "welcome";
  participant_id: string;
  seat: number;
  /** After so long without a message the connection counts as lost, s. */
  silence_s: number;
}
