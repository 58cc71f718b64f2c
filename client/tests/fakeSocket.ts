/** A socket that is open at once; tests say what it does with what it is sent. */
export class FakeSocket extends EventTarget {
  static OPEN = 1;
  readyState = 1;
  onopen: () => void = () => undefined;
  onmessage: (event: { data: string }) => void = () => undefined;
  onclose: () => void = () => undefined;

  say(message: object): void {
    this.onmessage({ data: JSON.stringify(message) });
  }
}
