/** A short, quiet tone: whoever is turned away hears that a step is done. */

const PITCH_HZ = 880;
const LOUDNESS = 0.06;
const LASTS_S = 0.35;

export class Chime {
  private context: AudioContext | null = null;

  /** Browsers let a page sound only after it was pressed: call it then. */
  open(): void {
    if ("AudioContext" in globalThis) this.context ??= new AudioContext();
  }

  ring(): void {
    const { context } = this;
    if (!context) return;
    const [tone, volume] = [context.createOscillator(), context.createGain()];
    tone.frequency.value = PITCH_HZ;
    volume.gain.setValueAtTime(LOUDNESS, context.currentTime);
    volume.gain.exponentialRampToValueAtTime(LOUDNESS / 100, context.currentTime + LASTS_S);
    tone.connect(volume).connect(context.destination);
    tone.start();
    tone.stop(context.currentTime + LASTS_S);
  }

  close(): void {
    void this.context?.close();
    this.context = null;
  }
}
