/**
 * What travels as JSON between server and page. Written from the server's OpenAPI document by
 * `python -m services.client_types`; change services/api/shapes.py and run that, never this file.
 */

/** The demo's meeting. */
export interface DemoMeeting {
  meeting_id: string;
}

/** The proof that a person is gone. */
export interface Erased {
  /** By table. */
  deleted_rows: Record<string, number>;
  deleted_objects: number;
  /** Rows and objects counted afterwards: 0. */
  remaining: number;
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

/** A room and who stands in it. */
export interface Meeting {
  id: string;
  name: string;
  join_url: string;
  performers: Performer[];
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

/** A room to open. */
export interface NewMeeting {
  name: string;
  model_ids?: string[];
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

/** What the process needs, and whether it is there. */
export interface Readiness {
  status: "ready" | "unready";
  checks: Record<string, string>;
}

/** A place in a meeting. */
export interface Seat {
  /** Opens this meeting's view. */
  token: string;
  seat: number;
  ice_servers: string[];
  whep_url: string;
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
