/** The picture beside the progress: one's own clip at first, then the model as it grows. */

import type { Api } from "../api/api";
import type { Clip, EnrolState } from "../enrolment/enrol";
import type { Job } from "../api/types";
import { h } from "./dom";
import { mark } from "./icons";

/** Share of a training before which its model looks worse than the first likeness, which is no start for it. */
const SHAPELESS = 0.1;

export interface PreviewPane {
  element: HTMLElement;
  show(state: EnrolState): void;
  close(): void;
}

export function previewPane(api: Api, clip: Clip | null): PreviewPane {
  const element = h("div", { className: "preview-pane" }, mark());
  const picture = h("img", { alt: "Your model so far", testId: "preview", hidden: true });
  element.append(picture);
  let clipAddress: string | null = null;
  let pictureAddress: string | null = null;
  let shownJob: Job | null = null;
  let fetching = false;
  let closed = false;

  const video = clip && (clip.preview ?? (/\.(mp4|mov|webm|m4v)$/i.test(clip.fileName) ? clip.blob : null));
  if (video) {
    clipAddress = URL.createObjectURL(video);
    const player = h("video", { muted: true, loop: true, playsInline: true, autoplay: true });
    // a clip that this browser can't play may still be one that the server can read
    player.addEventListener("error", () => player.remove());
    player.src = clipAddress;
    element.append(player);
  }

  /** One request at a time; progress that comes meanwhile is caught up with afterwards. */
  const refresh = async (job: Job): Promise<void> => {
    if (fetching) return;
    fetching = true;
    try {
      const address = URL.createObjectURL(await api.preview(job.id));
      if (closed) return URL.revokeObjectURL(address);
      picture.src = address;
      await picture.decode();
      if (pictureAddress) URL.revokeObjectURL(pictureAddress);
      pictureAddress = address;
      picture.hidden = false;
      element.classList.add("has-preview");
      // nobody sees it any more, and decoding it takes the strength of a phone
      element.querySelector("video")?.pause();
    } catch {
      // only a preview: the next progress brings the next picture
    } finally {
      fetching = false;
    }
    if (shownJob && shownJob !== job && !closed) void refresh(shownJob);
  };

  return {
    element,
    show: ({ job }) => {
      if (!job?.has_preview || job === shownJob) return;
      if (job.kind === "train" && job.progress < SHAPELESS) return;
      shownJob = job;
      void refresh(job);
    },
    close: () => {
      closed = true;
      for (const address of [clipAddress, pictureAddress]) {
        if (address) URL.revokeObjectURL(address);
      }
    },
  };
}
