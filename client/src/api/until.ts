/** Waiting for what events tell of, for so long and no longer. */

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
