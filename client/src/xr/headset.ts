/**
 * A meeting in a headset: the room by our own splat pass, once for each eye, and panels with buttons.
 *
 * The floor of the headset's space is the floor of the room. A trigger or a pinch presses what the
 * ray meets: a button of the board, or a place on the floor to step to. A stick turns in steps.
 */

import type { MeetingSession } from "../meeting/session";
import type { LiveView } from "../drawing/live";
import type { Eye, PassCamera } from "../splats/camera";
import { SplatBudget, SplatShares } from "../splats/budget";
import { headsetRules, type HeadsetStep } from "./headsetSteps";
import { panelInFrontOf, ViewerRig, homePose, SNAP_RAD } from "./rig";
import { MENU_PX, menuItems, type MenuAction, type MenuItem, type Sheet } from "./menu";
import { paintMenu, paintText } from "./paint";
import { Pointers, type Aim } from "./pointers";
import { CanvasPanel, QuadRenderer, ringQuad, rayQuad, type OverlayQuad } from "./quads";
import { column, eyeCamera, headPose, yawOf, type Matrix, type Quad } from "./space";
import type { HeadsetView } from "../drawing/headsetView";
import { StatusText } from "./statusText";

export interface HeadsetActions {
  /** Switch the microphone on, or off again. */
  microphone(): void;
  /** Leave the meeting. */
  leave(): void;
}

/** What is told of the pictures, once a second. */
export interface HeadsetStats {
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
  onStats: (numbers: HeadsetStats) => void = () => undefined;
  onEnd: () => void = () => undefined;

  private readonly rig = new ViewerRig();
  private readonly quads: QuadRenderer;
  private readonly menuPanel: CanvasPanel;
  private readonly statusPanel: CanvasPanel;
  private readonly pointers: Pointers;
  private readonly statusText: StatusText;
  private readonly budget = new SplatBudget<HeadsetStep>(headsetRules(1000 / PACE_HZ));
  private readonly shares = new SplatShares();
  private sheet: Sheet | null = null;
  private panels: { menu: Quad; words: Record<"closed" | "open", Quad>; yawRad: number } | null = null;
  private kept: readonly number[] = [];
  private pictures = 0;
  private toldMs = 0;
  private head: Matrix | null = null;

  /** Draw for `session` until it ends. Throws where this browser can't draw people. */
  static async enter(
    session: XRSession,
    live: LiveView,
    meetingSession: MeetingSession,
    ways: HeadsetActions,
  ): Promise<Headset> {
    const space = await session.requestReferenceSpace("local-floor");
    const rates = [...(session.supportedFrameRates ?? [])];
    if (rates.includes(PACE_HZ)) await session.updateTargetFrameRate?.(PACE_HZ);
    const view = live.beginHeadset(document.createElement("canvas"));
    try {
      const gl = view.room.graphics;
      if (!gl) throw new Error(view.room.obstacle ?? "");
      const headset = new Headset(session, space, gl, live, view, meetingSession, ways);
      headset.start();
      return headset;
    } catch (error) {
      // the page draws again where the session has ended meanwhile, too
      live.endHeadset();
      throw error;
    }
  }

  private constructor(
    private readonly session: XRSession,
    private readonly space: XRSpace,
    private readonly gl: WebGL2RenderingContext,
    private readonly live: LiveView,
    private readonly view: HeadsetView,
    private readonly meetingSession: MeetingSession,
    private readonly actions: HeadsetActions,
  ) {
    this.quads = new QuadRenderer(gl);
    this.menuPanel = new CanvasPanel(gl, MENU_PX.width, MENU_PX.height);
    this.statusPanel = new CanvasPanel(gl, WORDS_PX.width, WORDS_PX.height);
    this.statusText = new StatusText(meetingSession);
    this.pointers = new Pointers(session);
  }

  private start(): void {
    const { session, gl } = this;
    const options = { alpha: false, antialias: false, depth: false, stencil: false };
    const layer = new XRWebGLLayer(session, gl, options);
    session.updateRenderState({ baseLayer: layer });
    // whoever is recentred by the headset sits down anew
    this.space.addEventListener("reset", () => (this.head = this.panels = null));
    session.addEventListener("squeeze", () => (this.panels = null));
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
    this.statusText.close();
    this.live.endHeadset();
    this.onEnd();
  }

  private frame(nowMs: number, frame: XRFrame, layer: XRWebGLLayer): void {
    const pose = frame.getViewerPose(this.space);
    if (!pose) return;
    const head = pose.transform.matrix;
    this.placePanels(head);
    const aims = this.pointers.aims(frame, this.space, this.rig, this.targets());
    for (const { pressed, turned } of aims) {
      if (turned !== 0) this.rig.snapTurn(head, -turned * SNAP_RAD);
      if (pressed?.kind === "item") this.perform(pressed.item.action, head);
      if (pressed?.kind === "floor") this.rig.teleport(head, pressed.at, this.centre);
    }
    const eyes = this.eyes(pose, layer);
    const [first] = eyes;
    if (!first) return;
    this.reportView(head, first.camera);
    const middle = this.headCamera(head, first.camera);
    this.kept = this.shares.of(this.view.room, middle, this.budget.step.splats);
    const withPeople = this.view.room.drawEyes(eyes, middle, false, this.kept);
    const flats = this.overlayQuads(aims, column(this.rig.toRoom(head), 3), nowMs);
    for (const eye of eyes) this.quads.draw(eye, flats);
    this.live.headsetFrameDrawn(withPeople);
    this.publishStats(nowMs, layer);
  }

  private get centre(): readonly [number, number] {
    const [x, , z] = this.live.meeting.viewpoint.target;
    return [x, z];
  }

  /** Sit down at first; boards come along with whoever turns away from them. */
  private placePanels(head: Matrix): void {
    if (!this.head) this.rig.placeAt(head, homePose(this.live.meeting.viewpoint));
    this.head = head;
    const away = Math.abs(Math.sin(0.5 * (yawOf(head) - (this.panels?.yawRad ?? 0))));
    if (this.panels && away < Math.sin(0.5 * TURNED_AWAY_RAD)) return;
    const words = (belowM: number): Quad => panelInFrontOf(head, WORDS_M.ahead, belowM, WORDS_M.width, WORDS_M.height);
    this.panels = {
      menu: panelInFrontOf(head, MENU_M.ahead, MENU_M.below, MENU_M.width, MENU_M.height),
      words: { closed: words(WORDS_BELOW_M.closed), open: words(WORDS_BELOW_M.open) },
      yawRad: yawOf(head),
    };
  }

  private get items(): MenuItem[] {
    return menuItems(this.meetingSession.state, this.sheet, this.rig.standing);
  }

  private targets(): { quad: Quad; items: readonly MenuItem[] } | null {
    return this.panels && { quad: this.rig.quadToRoom(this.panels.menu), items: this.items };
  }

  private perform(act: MenuAction | undefined, head: Matrix): void {
    switch (act?.kind) {
      case "microphone":
        return this.actions.microphone();
      case "leave":
        this.end();
        return this.actions.leave();
      case "sheet":
        this.sheet = this.sheet === act.sheet ? null : act.sheet;
        return;
      case "send":
        if (!this.meetingSession.send(act.message)) this.statusText.show("Not sent: the connection is lost. Reconnecting…");
        return;
      case "turn":
        return this.rig.snapTurn(head, act.way * SNAP_RAD);
      case "height":
        return this.rig.setStanding(head, !this.rig.standing);
    }
  }

  private eyes(pose: XRViewerPose, layer: XRWebGLLayer): Eye[] {
    return pose.views.flatMap((view) => {
      view.requestViewportScale?.(this.budget.step.viewportScale);
      const viewport = layer.getViewport(view);
      if (!viewport || viewport.width === 0) return [];
      const { x, y, width, height } = viewport;
      const camera = eyeCamera(this.rig.toRoom(view.transform.matrix), view.projectionMatrix, width, height);
      return [{ camera, framebuffer: layer.framebuffer, x, y }];
    });
  }

  /** Splats are sorted once for both eyes: by depth before the head. */
  private headCamera(head: Matrix, eye: PassCamera): PassCamera {
    const projection = new Float32Array(16).fill(1, 0, 1).fill(1, 5, 6);
    return eyeCamera(this.rig.toRoom(head), projection, eye.width, eye.height);
  }

  private reportView(head: Matrix, { width, height, focalPx }: PassCamera): void {
    this.view.camera = headPose(this.rig.toRoom(head));
    this.view.fovYRad = 2 * Math.atan((0.5 * height) / focalPx[1]);
    this.view.size = { width, height };
  }

  private overlayQuads(aims: readonly Aim[], eye: readonly [number, number, number], nowMs: number): OverlayQuad[] {
    const { panels, items } = this;
    const rays: OverlayQuad[] = aims.flatMap(({ ray, target, endM }) => {
      const end = target ? endM : Math.min(RAY_M, endM);
      const tip = [0, 1, 2].map((axis) => (ray.from[axis] ?? 0) + end * (ray.along[axis] ?? 0));
      const [x = 0, y = 0, z = 0] = tip;
      const beam: OverlayQuad = { kind: "ray", quad: rayQuad(ray.from, [x, y, z], eye), colour: target ? ACCENT : LIGHT };
      return target?.kind === "floor" ? [beam, { kind: "ring", quad: ringQuad(target.at), colour: ACCENT }] : [beam];
    });
    if (!panels) return rays;
    const under = aims.map(({ target }) => target).find((over) => over?.kind === "item");
    const item = under?.kind === "item" ? under.item : null;
    this.menuPanel.show(JSON.stringify([items, item]), (on) => paintMenu(on, items, item));
    const lines = this.statusText.lines(nowMs, this.view.room);
    this.statusPanel.show(JSON.stringify(lines), (on) => paintText(on, lines));
    const board = (quad: Quad, shown: CanvasPanel): OverlayQuad => ({ kind: "board", quad: this.rig.quadToRoom(quad), board: shown });
    return [board(panels.words[this.sheet ? "open" : "closed"], this.statusPanel), board(panels.menu, this.menuPanel), ...rays];
  }

  private publishStats(nowMs: number, layer: XRWebGLLayer): void {
    if (this.budget.observeAt(nowMs) && layer.fixedFoveation != null) {
      layer.fixedFoveation = this.budget.step.foveation;
    }
    // whoever draws the fewest splats has no time to spare
    this.view.room.lays = !this.budget.atSmallest;
    this.pictures += 1;
    const since = nowMs - this.toldMs;
    if (since < NEWS_MS) return;
    this.onStats({ fps: Math.round((1000 * this.pictures) / since), splats: this.kept.reduce((all, one) => all + one, 0) });
    this.pictures = 0;
    this.toldMs = nowMs;
  }
}
