/**
 * A meeting in a headset: the room by our own splat pass, once for each eye, and boards to act by.
 *
 * The floor of the headset's space is the floor of the room. A trigger or a pinch presses what the
 * ray meets: a button of the board, or a place on the floor to step to. A stick turns in steps.
 */

import type { Attendance } from "../meeting/attendance";
import type { LiveView } from "../drawing/live";
import type { Eye, PassCamera } from "../splats/pass";
import { sharesOf, sizeInView, SplatBudget, steadyShares } from "./budget";
import { boardBefore, Footing, middleOf, seatPlace, SNAP_RAD } from "./footing";
import { MENU_PX, menuItems, type Act, type Item, type Sheet } from "./menu";
import { paintMenu, paintWords } from "./paint";
import { Pointers, type Aim } from "./pointers";
import { Board, Quads, ringAt, strip, type Flat } from "./quads";
import { column, eyeCamera, headPose, yawOf, type Matrix, type Quad } from "./space";
import type { Visit } from "../drawing/visit";
import { Words } from "./words";

export interface HeadsetWays {
  /** Switch the microphone on, or off again. */
  microphone(): void;
  /** Leave the meeting. */
  leave(): void;
}

/** What is told of the pictures, once a second. */
export interface HeadsetNumbers {
  fps: number;
  /** Splats of everybody that are drawn. */
  splats: number;
}

/** Pictures a second where the headset lets us choose. */
const PACE_HZ = 72;
const MENU_M = { width: 0.62, height: (0.62 * MENU_PX.height) / MENU_PX.width, ahead: 0.75, below: 0.42 };
const WORDS_PX = { width: 1024, height: 200 };
const WORDS_M = { width: 0.9, height: (0.9 * WORDS_PX.height) / WORDS_PX.width, ahead: 1.5 };
/** Words lie over the buttons; where a sheet is open, over that. */
const WORDS_BELOW_M = { closed: 0.68, open: 0.24 };
/** Boards come round to whoever has turned away so far. */
const TURNED_AWAY_RAD = 1.2;
const RAY_M = 1;
/** How often numbers of the pictures are told. */
const NEWS_MS = 1000;
const LIGHT = [0.96, 0.98, 0.976] as const;
const ACCENT = [0.373, 0.863, 0.753] as const;

export class Headset {
  onNumbers: (numbers: HeadsetNumbers) => void = () => undefined;
  onEnd: () => void = () => undefined;

  private readonly footing = new Footing();
  private readonly quads: Quads;
  private readonly menu: Board;
  private readonly strip: Board;
  private readonly pointers: Pointers;
  private readonly words: Words;
  private readonly budget: SplatBudget;
  private sheet: Sheet | null = null;
  private boards: { menu: Quad; words: Record<"closed" | "open", Quad>; yawRad: number } | null = null;
  private kept: readonly number[] = [];
  private pictures = 0;
  private toldMs = 0;
  private head: Matrix | null = null;

  /** Draw for `session` until it ends. Throws where this browser can't draw people. */
  static async enter(
    session: XRSession,
    live: LiveView,
    attendance: Attendance,
    ways: HeadsetWays,
  ): Promise<Headset> {
    const space = await session.requestReferenceSpace("local-floor");
    const { seat } = await attendance.getSeat();
    const rates = [...(session.supportedFrameRates ?? [])];
    if (rates.includes(PACE_HZ)) await session.updateTargetFrameRate?.(PACE_HZ);
    const visit = live.beginVisit(document.createElement("canvas"));
    const gl = visit.room.graphics;
    if (!gl) {
      live.endVisit();
      throw new Error(visit.room.obstacle ?? "");
    }
    const headset = new Headset(session, space, gl, live, visit, attendance, ways, seat);
    headset.start();
    return headset;
  }

  private constructor(
    private readonly session: XRSession,
    private readonly space: XRSpace,
    private readonly gl: WebGL2RenderingContext,
    private readonly live: LiveView,
    private readonly visit: Visit,
    private readonly attendance: Attendance,
    private readonly ways: HeadsetWays,
    private readonly seat: number,
  ) {
    this.quads = new Quads(gl);
    this.menu = new Board(gl, MENU_PX.width, MENU_PX.height);
    this.strip = new Board(gl, WORDS_PX.width, WORDS_PX.height);
    this.words = new Words(attendance);
    this.budget = new SplatBudget(1000 / PACE_HZ);
    this.pointers = new Pointers(session);
  }

  private start(): void {
    const { session, gl } = this;
    const options = { alpha: false, antialias: false, depth: false, stencil: false };
    const layer = new XRWebGLLayer(session, gl, options);
    session.updateRenderState({ baseLayer: layer });
    // whoever is recentred by the headset sits down anew
    this.space.addEventListener("reset", () => (this.head = this.boards = null));
    session.addEventListener("squeeze", () => (this.boards = null));
    session.addEventListener("end", () => this.ended());
    const next = (milliseconds: number, frame: XRFrame): void => {
      session.requestAnimationFrame(next);
      this.frame(milliseconds, frame, layer);
    };
    session.requestAnimationFrame(next);
  }

  end(): void {
    void this.session.end().catch(() => undefined);
  }

  private ended(): void {
    this.words.close();
    this.live.endVisit();
    this.onEnd();
  }

  private frame(nowMs: number, frame: XRFrame, layer: XRWebGLLayer): void {
    const pose = frame.getViewerPose(this.space);
    if (!pose) return;
    const head = pose.transform.matrix;
    this.settle(head);
    const aims = this.pointers.aims(frame, this.space, this.footing, this.targets());
    for (const { pressed, turned } of aims) {
      if (turned !== 0) this.footing.turn(head, -turned * SNAP_RAD);
      if (pressed?.kind === "item") this.act(pressed.item.act, head);
      if (pressed?.kind === "floor") this.footing.step(head, pressed.at, this.middle);
    }
    const eyes = this.eyes(pose, layer);
    const [first] = eyes;
    if (!first) return;
    this.look(head, first.camera);
    this.share(head, first.camera);
    const middle = this.headCamera(head, first.camera);
    const withPeople = this.visit.room.drawEyes(eyes, middle, false, this.kept);
    const flats = this.flats(aims, column(this.footing.room(head), 3), nowMs);
    for (const eye of eyes) this.quads.draw(eye, flats);
    this.live.visited(withPeople);
    this.count(nowMs, layer);
  }

  private get middle(): readonly [number, number] {
    return middleOf(this.live.meeting.performers);
  }

  /** Sit down at first; boards come along with whoever turns away from them. */
  private settle(head: Matrix): void {
    if (!this.head) this.footing.sit(head, seatPlace(this.seat, this.live.meeting.performers));
    this.head = head;
    const away = Math.abs(Math.sin(0.5 * (yawOf(head) - (this.boards?.yawRad ?? 0))));
    if (this.boards && away < Math.sin(0.5 * TURNED_AWAY_RAD)) return;
    const words = (belowM: number): Quad => boardBefore(head, WORDS_M.ahead, belowM, WORDS_M.width, WORDS_M.height);
    this.boards = {
      menu: boardBefore(head, MENU_M.ahead, MENU_M.below, MENU_M.width, MENU_M.height),
      words: { closed: words(WORDS_BELOW_M.closed), open: words(WORDS_BELOW_M.open) },
      yawRad: yawOf(head),
    };
  }

  private get items(): Item[] {
    return menuItems(this.attendance.state, this.sheet, this.footing.standing);
  }

  private targets(): { quad: Quad; items: readonly Item[] } | null {
    return this.boards && { quad: this.footing.roomQuad(this.boards.menu), items: this.items };
  }

  private act(act: Act | undefined, head: Matrix): void {
    switch (act?.kind) {
      case "microphone":
        return this.ways.microphone();
      case "leave":
        this.end();
        return this.ways.leave();
      case "sheet":
        this.sheet = this.sheet === act.sheet ? null : act.sheet;
        return;
      case "wish":
        if (!this.attendance.wish(act.message)) this.words.tell("Not sent: the connection is lost. It comes back by itself.");
        return;
      case "turn":
        return this.footing.turn(head, act.way * SNAP_RAD);
      case "height":
        return this.footing.setStanding(head, !this.footing.standing);
    }
  }

  private eyes(pose: XRViewerPose, layer: XRWebGLLayer): Eye[] {
    return pose.views.flatMap((view) => {
      view.requestViewportScale?.(this.budget.step.viewportScale);
      const viewport = layer.getViewport(view);
      if (!viewport || viewport.width === 0) return [];
      const { x, y, width, height } = viewport;
      const camera = eyeCamera(this.footing.room(view.transform.matrix), view.projectionMatrix, width, height);
      return [{ camera, framebuffer: layer.framebuffer, x, y }];
    });
  }

  /** Splats are sorted once for both eyes: by depth before the head. */
  private headCamera(head: Matrix, eye: PassCamera): PassCamera {
    const projection = new Float32Array(16).fill(1, 0, 1).fill(1, 5, 6);
    return eyeCamera(this.footing.room(head), projection, eye.width, eye.height);
  }

  private look(head: Matrix, { width, height, focalPx }: PassCamera): void {
    this.visit.camera = headPose(this.footing.room(head));
    this.visit.fovYRad = 2 * Math.atan((0.5 * height) / focalPx[1]);
    this.visit.size = { width, height };
  }

  private share(head: Matrix, eye: PassCamera): void {
    const { room } = this.visit;
    const camera = this.headCamera(head, eye);
    const most = this.budget.step.splats;
    const sizes = room.places.map((place) => sizeInView(camera, place));
    this.kept = steadyShares(this.kept, sharesOf(room.counts, sizes, most), most);
  }

  private flats(aims: readonly Aim[], eye: readonly [number, number, number], nowMs: number): Flat[] {
    const { boards, items } = this;
    const rays: Flat[] = aims.flatMap(({ ray, over, endM }) => {
      const end = over ? endM : Math.min(RAY_M, endM);
      const tip = [0, 1, 2].map((axis) => (ray.from[axis] ?? 0) + end * (ray.along[axis] ?? 0));
      const [x = 0, y = 0, z = 0] = tip;
      const beam: Flat = { kind: "ray", quad: strip(ray.from, [x, y, z], eye), colour: over ? ACCENT : LIGHT };
      return over?.kind === "floor" ? [beam, { kind: "ring", quad: ringAt(over.at), colour: ACCENT }] : [beam];
    });
    if (!boards) return rays;
    const under = aims.map(({ over }) => over).find((over) => over?.kind === "item");
    const item = under?.kind === "item" ? under.item : null;
    this.menu.show(JSON.stringify([items, item]), (on) => paintMenu(on, items, item));
    const lines = this.words.lines(nowMs, this.visit.room);
    this.strip.show(JSON.stringify(lines), (on) => paintWords(on, lines));
    const board = (quad: Quad, shown: Board): Flat => ({ kind: "board", quad: this.footing.roomQuad(quad), board: shown });
    return [board(boards.words[this.sheet ? "open" : "closed"], this.strip), board(boards.menu, this.menu), ...rays];
  }

  private count(nowMs: number, layer: XRWebGLLayer): void {
    if (this.budget.observe(nowMs) && layer.fixedFoveation != null) {
      layer.fixedFoveation = this.budget.step.foveation;
    }
    this.pictures += 1;
    const since = nowMs - this.toldMs;
    if (since < NEWS_MS) return;
    this.onNumbers({ fps: Math.round((1000 * this.pictures) / since), splats: this.kept.reduce((all, one) => all + one, 0) });
    this.pictures = 0;
    this.toldMs = nowMs;
  }
}
