/** What an upload is doing, in words for whoever sends a clip. */

import type { UploadProgress } from "../api/upload";

/** What an upload is at, where there is more to say than how far it is. */
export const UPLOAD_WORDS: Readonly<Record<UploadProgress["phase"] | "hashing", string>> = {
  hashing: "Preparing your clip",
  sending: "",
  waiting: "Interrupted, trying again",
};
