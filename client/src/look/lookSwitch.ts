/** Whether pictures of oneself leave the device: while they are wanted and the network has room for them. */

export class LookSwitch {
  private wanted = false;
  private poorNetwork = false;

  /** `onChange` hears of each change, and whether pictures leave from now on. */
  constructor(private readonly onChange: (on: boolean) => void) {}

  get on(): boolean {
    return this.wanted && !this.poorNetwork;
  }

  /** Wanted, and held back by the network. */
  get paused(): boolean {
    return this.wanted && this.poorNetwork;
  }

  setWanted(wanted: boolean): void {
    this.change(() => (this.wanted = wanted));
  }

  setPoorNetwork(poor: boolean): void {
    this.change(() => (this.poorNetwork = poor));
  }

  private change(apply: () => void): void {
    const [on, paused] = [this.on, this.paused];
    apply();
    if (this.on !== on || this.paused !== paused) this.onChange(this.on);
  }
}
