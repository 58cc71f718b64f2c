/**
 * The part of the WebXR Device API that we use (https://www.w3.org/TR/webxr/); TypeScript's library
 * of the DOM has none of it. Matrices are 4 x 4, column by column.
 */

interface XRRigidTransform {
  readonly matrix: Float32Array;
}

interface XRPose {
  readonly transform: XRRigidTransform;
}

interface XRView {
  readonly eye: "left" | "right" | "none";
  readonly projectionMatrix: Float32Array;
  readonly transform: XRRigidTransform;
  /** Not in every browser. */
  requestViewportScale?(scale: number): void;
}

interface XRViewerPose extends XRPose {
  readonly views: readonly XRView[];
}

type XRSpace = EventTarget;

interface XRFrame {
  getViewerPose(space: XRSpace): XRViewerPose | undefined;
  getPose(space: XRSpace, base: XRSpace): XRPose | undefined;
}

interface XRInputSource {
  readonly targetRaySpace: XRSpace;
  readonly gamepad?: Gamepad | null;
}

interface XRInputSourceEvent extends Event {
  readonly inputSource: XRInputSource;
}

interface XRInputSourcesChangeEvent extends Event {
  readonly removed: readonly XRInputSource[];
}

interface XRSession extends EventTarget {
  readonly inputSources: Iterable<XRInputSource>;
  /** Not in every browser. */
  readonly supportedFrameRates?: Float32Array;
  updateTargetFrameRate?(rate: number): Promise<void>;
  requestReferenceSpace(kind: "local-floor"): Promise<XRSpace>;
  updateRenderState(state: { baseLayer: XRWebGLLayer }): void;
  requestAnimationFrame(callback: (milliseconds: number, frame: XRFrame) => void): number;
  end(): Promise<void>;
  addEventListener(
    kind: "selectstart" | "selectend" | "squeeze",
    listener: (event: XRInputSourceEvent) => void,
  ): void;
  addEventListener(kind: "inputsourceschange", listener: (event: XRInputSourcesChangeEvent) => void): void;
  addEventListener(kind: "end", listener: () => void): void;
}

interface XRViewport {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

declare class XRWebGLLayer {
  constructor(
    session: XRSession,
    context: WebGL2RenderingContext,
    options: { alpha: boolean; antialias: boolean; depth: boolean; stencil: boolean },
  );
  readonly framebuffer: WebGLFramebuffer | null;
  /** 0 to 1, how coarse the outer parts may be; null where it can't be chosen, or unknown. */
  fixedFoveation?: number | null;
  getViewport(view: XRView): XRViewport | undefined;
}

interface XRSystem extends EventTarget {
  isSessionSupported(mode: "immersive-vr"): Promise<boolean>;
  requestSession(
    mode: "immersive-vr",
    options: { requiredFeatures: string[]; optionalFeatures: string[] },
  ): Promise<XRSession>;
}

interface Navigator {
  readonly xr?: XRSystem;
}
