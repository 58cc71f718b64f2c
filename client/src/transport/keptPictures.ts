/** Pictures of oneself that the server keeps of a live look, to learn from if their owner agrees. */

import type { Job, KeptFrames } from "../api/types";
import type { WhepConnection } from "./whep";

export class KeptPictures {
  constructor(private readonly connection: Pick<WhepConnection, "keptFrames">) {}

  /** Switch keeping on or off; what is kept. Throws Problem. */
  async keep(on: boolean): Promise<KeptFrames> {
    return (await this.connection.keptFrames("PUT", { on })) as KeptFrames;
  }

  /** Have what is kept stored and learnt from. Throws Problem. */
  async learn(): Promise<Job> {
    return (await this.connection.keptFrames("POST")) as Job;
  }

  /** Throws Problem. */
  async drop(): Promise<void> {
    await this.connection.keptFrames("DELETE");
  }
}
