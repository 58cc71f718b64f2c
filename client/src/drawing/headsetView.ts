/** The view through a headset: the room that it draws, and where its viewer's head is. */

import type { Size } from "../viewpoint/framing";
import type { LocalRoom } from "../splats/localRoom";
import type { CameraPose } from "../viewpoint/viewpoint";

export interface HeadsetView {
  readonly room: LocalRoom;
  /** Of the head, anew for each picture. */
  camera: CameraPose;
  fovYRad: number;
  /** Of one eye's picture. */
  size: Size;
}
