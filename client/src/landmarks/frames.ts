/** Each picture of a camera that a video element shows, by the time it was taken. */

/** Tell each picture's time, ms since 1970, until the returned function is called. */
export function eachFrame(video: HTMLVideoElement, onFrame: (timeMs: number) => void): () => void {
  let [timeMs, callback] = [0, 0];
  const next = (): void => {
    callback = video.requestVideoFrameCallback((nowMs, { captureTime = nowMs }) => {
      // cameras do not always tell rising times, and the detector needs them
      timeMs = Math.max(timeMs + 1, performance.timeOrigin + captureTime);
      onFrame(timeMs);
      next();
    });
  };
  next();
  return () => video.cancelVideoFrameCallback(callback);
}
