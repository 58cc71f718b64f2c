/** Waiting: for so long, or for what events tell of. */

/** Wait until `there` holds after events of `kind`, at most so long. */
export function waitFor(
  target: EventTarget,
  kind: string,
  there: () => boolean,
  milliseconds: number,
): Promise<void> {
  return new Promise((resolve) => {
    const done = (): void => {
      clearTimeout(timer);
      target.removeEventListener(kind, look);
      resolve();
    };
    const look = (): void => {
      if (there()) done();
    };
    const timer = setTimeout(done, milliseconds);
    target.addEventListener(kind, look);
    look();
  });
}

/** All of our own addresses are known, or enough time has gone by. */
export function iceGathered(peer: RTCPeerConnection, milliseconds: number): Promise<void> {
  const complete = (): boolean => peer.iceGatheringState === "complete";
  return waitFor(peer, "icegatheringstatechange", complete, milliseconds);
}

/** Throws the signal's reason when it is aborted meanwhile. */
export function sleep(milliseconds: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const stop = (): void => {
      clearTimeout(timer);
      reject(signal?.reason as unknown);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resolve();
    }, milliseconds);
    if (signal?.aborted) stop();
    else signal?.addEventListener("abort", stop, { once: true });
  });
}
