/** What one speaks, written down by the browser, where it offers that (Web Speech API). */

interface Alternative {
  readonly transcript: string;
}
interface Result extends ArrayLike<Alternative> {
  readonly isFinal: boolean;
}
interface ResultEvent extends Event {
  readonly resultIndex: number;
  readonly results: ArrayLike<Result>;
}
/** Of the Web Speech API, which TypeScript does not know. */
interface Recognition extends EventTarget {
  continuous: boolean;
  lang: string;
  start(): void;
  abort(): void;
}
type MakeRecognition = new () => Recognition;

/** After this long a pause it begins again: browsers end it after some silence. */
const AGAIN_MS = 300;
const LONGEST = 500;
/** Nothing that trying again would mend. */
const FINAL = new Set(["not-allowed", "service-not-allowed", "audio-capture", "language-not-supported"]);

/** The browser's own, if it has one. */
export function recognitionOf(scope: object = globalThis): MakeRecognition | null {
  const found = scope as { SpeechRecognition?: MakeRecognition; webkitSpeechRecognition?: MakeRecognition };
  return found.SpeechRecognition ?? found.webkitSpeechRecognition ?? null;
}

export class Dictation {
  private running: Recognition | null = null;
  private again: ReturnType<typeof setTimeout> | undefined;
  private wanted = false;

  /** `onText` hears each finished sentence; `onRefused` why nothing comes. */
  constructor(
    private readonly make: MakeRecognition,
    private readonly onText: (text: string) => void,
    private readonly onRefused: () => void,
  ) {}

  listen(on: boolean): void {
    if (on === this.wanted) return;
    this.wanted = on;
    clearTimeout(this.again);
    if (on) return this.begin();
    this.running?.abort();
    this.running = null;
  }

  private begin(): void {
    const recognition = new this.make();
    this.running = recognition;
    recognition.continuous = true;
    recognition.lang = globalThis.navigator?.language ?? "en";
    recognition.addEventListener("result", (event) => this.take(event as ResultEvent));
    recognition.addEventListener("error", (event) => {
      if (!FINAL.has((event as Event & { error?: string }).error ?? "")) return;
      this.wanted = false;
      this.onRefused();
    });
    recognition.addEventListener("end", () => {
      if (this.wanted && this.running === recognition) this.again = setTimeout(() => this.begin(), AGAIN_MS);
    });
    recognition.start();
  }

  private take({ results, resultIndex }: ResultEvent): void {
    if (!this.wanted) return;
    for (let i = resultIndex; i < results.length; i++) {
      const result = results[i];
      const text = result?.isFinal ? (result[0]?.transcript.trim().slice(0, LONGEST) ?? "") : "";
      if (text !== "") this.onText(text);
    }
  }
}
