import motion from "../../../tests/services/live/motion.json";
import { BODY_BYTES } from "../../src/motion/constants";

/** How the server tells a page the first case's body. */
export const BODY_PACKET = bodyPacket();

function bodyPacket(): ArrayBuffer {
  const bytes = new ArrayBuffer(BODY_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, 1);
  data.setUint8(1, 9);
  const { rest, landmarks, yaw } = motion.cases[0]!.body;
  [yaw, ...rest, ...landmarks].forEach((value, i) => data.setFloat32(4 + 4 * i, value, true));
  return bytes;
}
