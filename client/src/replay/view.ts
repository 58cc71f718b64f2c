/** A recorded meeting on the page: the room at any moment, from any side, with what was said. */

import type { Api } from "../api/api";
import { attachControls } from "../viewpoint/controls";
import { Problem, asProblem, sentence } from "../api/problem";
import { isFinal } from "../api/api";
import { h, prefersReducedMotion } from "../views/dom";
import { icon } from "../views/icons";
import { button, notice, viewportTitle, type View } from "../views/shell";
import type { LoadedRecording } from "./load";
import { Player, SPEEDS, clockText } from "./player";
import { ReplayRenderer } from "./renderer";
import { indexAt } from "./tracks";
import { RecordedVoices } from "./voices";

const VOICES_MS = 200;
const STEP_MS = 5000;
const CHATS_SHOWN = 4;

interface ReplayHooks {
  onLeave(): void;
}

export function replayView(api: Api, loaded: LoadedRecording, hooks: ReplayHooks): View {
  const { recording } = loaded;
  const player = new Player(1000 * recording.duration_s);
  const renderer = new ReplayRenderer(api, loaded, player, !prefersReducedMotion());
  const voices = new RecordedVoices(loaded.voices, player);
  const controls = playerControls(player);
  const chat = h("div", { className: "previews", testId: "replay-chat", attributes: { "aria-live": "polite" } });
  const words = h("div", { className: "viewport-centre" });
  renderer.canvas.dataset["testid"] = "replay";
  renderer.canvas.setAttribute("role", "img");
  renderer.canvas.setAttribute("aria-label", `Recording of ${recording.name}`);
  const element = h(
    "main",
    { className: "viewport", tabIndex: 0, attributes: { "aria-label": "A recorded meeting" } },
    renderer.canvas,
    words,
    h(
      "div",
      { className: "viewport-top" },
      viewportTitle(recording.name),
      h("div", { className: "viewport-actions" }, ...actions(api, loaded, words, hooks)),
    ),
    h("div", { className: "notifications" }, chat),
    h("div", { className: "viewport-bottom" }, controls.element),
  );
  const release = attachControls(element, renderer.viewpoint, () => undefined);
  const follow = (): void => {
    voices.synchronise();
    controls.update();
    showChat(chat, loaded, player.ms);
  };
  player.onChange = follow;
  const following = setInterval(follow, VOICES_MS);
  let lastMs = performance.now();
  let frames = 0;
  let ticking = 0;
  let obstacle: string | null = null;
  const frame = (nowMs: number): void => {
    ticking = requestAnimationFrame(frame);
    renderer.viewpoint.step(Math.max(0, (nowMs - lastMs) / 1000));
    lastMs = nowMs;
    player.tick();
    if (renderer.draw()) renderer.canvas.dataset["frames"] = String((frames += 1));
    voices.setPositions(renderer.viewpoint.camera, (memberId) => renderer.headPosition(memberId));
    if (renderer.obstacle !== obstacle) {
      // once, so that it hides no later notice
      obstacle = renderer.obstacle;
      words.replaceChildren(...(obstacle === null ? [] : [h("p", { className: "sheet" }, obstacle)]));
    }
  };
  ticking = requestAnimationFrame(frame);
  follow();
  return {
    element,
    close: () => {
      cancelAnimationFrame(ticking);
      clearInterval(following);
      release();
      voices.close();
      renderer.close();
    },
  };
}

function playerControls(player: Player): { element: HTMLElement; update(): void } {
  const toggle = button("Play", () => (player.playing ? player.pause() : player.play()), {
    look: "glass",
    icon: "play",
    testId: "replay-play",
  });
  const seek = h("input", { type: "range", min: "0", max: String(player.durationMs), step: "any", testId: "replay-seek" });
  seek.setAttribute("aria-label", "Moment of the recording");
  seek.addEventListener("input", () => player.seek(Number(seek.value)));
  const clock = h("output", { testId: "replay-clock" });
  const speed = h("select", { testId: "replay-speed" }, ...SPEEDS.map((value) => h("option", { value: String(value) }, `${value} ×`)));
  speed.value = "1";
  speed.setAttribute("aria-label", "Speed");
  speed.addEventListener("change", () => player.setSpeed(Number(speed.value)));
  const element = h("div", { className: "dock glass replay-bar", attributes: { role: "group" } }, toggle, seek, clock, speed);
  element.setAttribute("aria-label", "Replay");
  // moves that begin here are none of the viewpoint
  for (const kind of ["pointerdown", "wheel", "dblclick"]) element.addEventListener(kind, (event) => event.stopPropagation());
  element.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.target !== seek) return;
    const step = { ArrowRight: STEP_MS, ArrowLeft: -STEP_MS }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    player.seek(player.ms + step);
  });
  let shown: boolean | null = null;
  return {
    element,
    update: () => {
      seek.value = String(player.ms);
      clock.value = `${clockText(player.ms)} / ${clockText(player.durationMs)}`;
      seek.setAttribute("aria-valuetext", clock.value);
      if (shown === player.playing) return;
      shown = player.playing;
      toggle.querySelector("svg")?.replaceWith(icon(shown ? "pause" : "play"));
      toggle.querySelector("span")?.replaceChildren(shown ? "Pause" : "Play");
    },
  };
}

function showChat(place: HTMLElement, { recording, chats }: LoadedRecording, ms: number): void {
  const names = new Map(recording.members.map(({ participant_id: id, name }) => [id, name]));
  const said = [...chats].flatMap(([who, { times, items }]) =>
    items.slice(0, indexAt(times, ms) + 1).map((text, index) => ({ at: times[index] ?? 0, who, text })),
  );
  const newest = said.sort((a, b) => a.at - b.at).slice(-CHATS_SHOWN);
  const key = newest.map(({ at, who }) => `${at} ${who}`).join();
  if (place.dataset["key"] === key) return;
  place.dataset["key"] = key;
  place.replaceChildren(
    ...newest.map(({ who, text }) =>
      h("p", { className: "notification glass" }, h("strong", {}, names.get(who) ?? "Somebody"), ` ${text}`),
    ),
  );
}

function actions(api: Api, { recording }: LoadedRecording, words: HTMLElement, hooks: ReplayHooks): HTMLElement[] {
  const fail = (error: unknown): void => words.replaceChildren(h("div", { className: "sheet" }, notice(asProblem(error))));
  const film = button("Export video", () => void make(), { look: "glass", icon: "camera", testId: "replay-export" });
  const make = async (): Promise<void> => {
    film.disabled = true;
    const label = film.querySelector("span");
    try {
      let job = await api.exportRecording(recording.id, { path: [], width: 1280, height: 720, fov_deg: 35 });
      for (; !isFinal(job); job = await api.job(job.id)) {
        label?.replaceChildren(`Exporting, ${Math.round(100 * job.progress)} %`);
        await new Promise((resolve) => setTimeout(resolve, 1000));
      }
      if (job.state !== "succeeded") throw job.error ? Problem.from(job.error) : new Problem("The export was stopped", sentence(job.message));
      const link = h("a", { download: `${recording.name}.mp4` });
      link.href = URL.createObjectURL(await api.file(`/v1/recordings/${recording.id}/videos/${job.id}`));
      link.click();
      URL.revokeObjectURL(link.href);
    } catch (error) {
      fail(error);
    }
    film.disabled = false;
    label?.replaceChildren("Export video");
  };
  const confirmed = (action: () => Promise<void>, question: string) => (): void => {
    if (confirm(question)) action().then(hooks.onLeave, fail);
  };
  const erase = recording.mine
    ? button("Delete", confirmed(() => api.deleteRecording(recording.id), "Delete this recording for everybody?"), { look: "glass", icon: "close", testId: "replay-delete" })
    : button("Remove me", confirmed(() => api.leaveRecording(recording.id), "Delete your motion, voice and messages from this recording?"), { look: "glass", icon: "close", testId: "replay-mine" });
  return [film, erase, button("Leave", hooks.onLeave, { look: "glass", icon: "leave" })];
}
