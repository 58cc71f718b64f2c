/** The shapes of the server's REST calls (`/v1`), as the page uses them. */

export type Vec3 = readonly [number, number, number];
/** Unit quaternion, real part first. */
export type Quaternion = readonly [number, number, number, number];

export interface GuestToken {
  token: string;
  expires_at: string;
}

export interface Person {
  id: string;
  name: string;
  created_at: string;
}

export type SequenceKind = "video" | "frames" | "keypoints";

/** What the capture says about a clip; every part may be missing. */
export interface Quality {
  advice?: string[];
  [measure: string]: unknown;
}

export interface Sequence {
  id: string;
  person_id: string;
  kind: SequenceKind;
  state: "uploaded" | "capturing" | "ready";
  frames: number | null;
  frames_per_second: number | null;
  duration_s: number | null;
  quality: Quality | null;
  thumbnail_url: string | null;
  job_id: string | null;
}

export type JobState = "queued" | "running" | "succeeded" | "failed" | "cancelled";

/** RFC 9457 problem details. */
export interface ProblemDetails {
  type?: string;
  title: string;
  status?: number;
  detail?: string;
}

export interface Job {
  id: string;
  kind: "capture" | "train";
  state: JobState;
  /** 0 to 1. */
  progress: number;
  message: string;
  has_preview: boolean;
  sequence_id: string | null;
  model_id: string | null;
  error: ProblemDetails | null;
}

export interface Performer {
  id: string;
  name: string;
  model_id: string;
  /** World, m. */
  position: Vec3;
  yaw_rad: number;
}

export interface Meeting {
  id: string;
  name: string;
  join_url: string;
  performers: Performer[];
}

/** A seat in a meeting: what `POST /v1/meetings/{id}/join` answers. */
export interface Seat {
  token: string;
  ice_servers: (string | RTCIceServer)[];
  whep_url: string;
  performers: Performer[];
}
