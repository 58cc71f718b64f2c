/** Files of models on their way: each is asked for once, and its beginning is handed out early. */

/** What is whole so soon after its beginning is drawn at once. */
const SOON_MS = 100;

/** The file of a model; null where it has none that a page can draw. May tell of its first bytes before. */
export type LoadSplats = (modelId: string, onBeginning: (bytes: ArrayBuffer) => void) => Promise<ArrayBuffer | null>;

/** A file on its way: as much of it as can be drawn already, and all of it. */
export interface Arriving {
  beginning: Promise<ArrayBuffer | null>;
  /** The beginning is less than the whole. */
  partial: boolean;
  whole: Promise<ArrayBuffer | null>;
}

export class ArrivingFiles {
  private readonly files = new Map<string, Arriving>();

  constructor(private readonly load: LoadSplats) {}

  /** Keep nothing of a model, and fetch it anew should it be asked for. */
  forget(modelId: string): void {
    this.files.delete(modelId);
  }

  /** The file of this model; one that could not be had is asked for again the next time. */
  get(modelId: string): Arriving {
    const known = this.files.get(modelId);
    if (known) return known;
    let begin: (bytes: ArrayBuffer) => void = () => undefined;
    const early = new Promise<ArrayBuffer>((resolve) => (begin = resolve));
    const whole = this.load(modelId, (bytes) => {
      // on a quick line everything is here before its beginning would be drawn
      setTimeout(() => {
        arriving.partial = true;
        begin(bytes);
      }, SOON_MS);
    });
    const arriving: Arriving = { beginning: Promise.race([early, whole]), partial: false, whole };
    this.files.set(modelId, arriving);
    const settle = (then?: Arriving): void => {
      if (this.files.get(modelId) !== arriving) return; // forgotten meanwhile
      if (then) this.files.set(modelId, then);
      else this.files.delete(modelId);
    };
    whole.then(
      () => settle({ beginning: whole, partial: false, whole }),
      () => settle(),
    );
    return arriving;
  }
}
