"""What a page plays and shows, with the times at which it does, by the clock of this machine."""

from __future__ import annotations

import base64
import json

import cv2
import numpy as np
from playwright.sync_api import Page

from benchmarks.lipsync.offsets import Shown, Sound

SIDE_PX = 64
"""Of what is kept of each picture, grey."""
Box = tuple[float, float, float, float]
"""Left, top, width and height, as shares of the picture."""
_METER = """registerProcessor('loudness', class extends AudioWorkletProcessor {
  constructor() { super(); this.blocks = []; }
  process([input]) {
    let peak = 0;
    for (const sample of input[0] ?? []) peak = Math.max(peak, Math.abs(sample));
    this.blocks.push([currentTime, peak]);
    if (this.blocks.length === 32) this.port.postMessage(this.blocks.splice(0));
    return true;
  }
});"""
_METER_ADDRESS = f"data:text/javascript;base64,{base64.b64encode(_METER.encode()).decode()}"
_LISTEN = """window.heard = [];
const connect = AudioNode.prototype.connect, meters = new WeakMap();
async function listen(node) {
  const { context } = node;
  if (!meters.has(context)) meters.set(context, context.audioWorklet.addModule(METER));
  await meters.get(context);
  const meter = new AudioWorkletNode(context, 'loudness', { numberOfOutputs: 0 });
  connect.call(node, meter);
  meter.port.onmessage = ({ data }) => {
    const { contextTime, performanceTime } = context.getOutputTimestamp();
    const offset = performance.timeOrigin + performanceTime - 1000 * contextTime;
    for (const [time, peak] of data) heard.push([1000 * time, peak, offset]);
  };
}
AudioNode.prototype.connect = function (to, ...rest) {
  const ends = [AudioDestinationNode, MediaStreamAudioDestinationNode];
  if (ends.some((end) => to instanceof end)) void listen(this);
  return connect.call(this, to, ...rest);
};
const { drawArrays } = WebGL2RenderingContext.prototype;
WebGL2RenderingContext.prototype.drawArrays = function (...all) {
  drawArrays.apply(this, all);
  if (window.onDrawn?.canvas !== this.canvas || window.onDrawn.waits) return;
  window.onDrawn.waits = true;
  queueMicrotask(() => window.onDrawn.look(this)); // once the picture is whole, before it is shown
};"""
_WATCH = """([selector, [x, y, w, h]]) => {
  window.seen = [];
  const source = document.querySelector(selector);
  const keep = (rgba, columns, rows, atMs) => {
    let text = '';
    for (let at = 0; at < rgba.length; at += 4) {
      text += String.fromCharCode((rgba[at] + 2 * rgba[at + 1] + rgba[at + 2]) >> 2);
    }
    seen.push([performance.timeOrigin + atMs, columns, rows, text]);
  };
  const boxOf = (width, height) => [x * width, y * height, w * width, h * height].map(Math.round);
  if (source instanceof HTMLVideoElement) {
    const part = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    const next = (_, { expectedDisplayTime }) => {
      source.requestVideoFrameCallback(next);
      const box = boxOf(source.videoWidth, source.videoHeight);
      const [, , columns, rows] = box;
      Object.assign(part.canvas, { width: columns, height: rows });
      part.drawImage(source, ...box, 0, 0, columns, rows);
      keep(part.getImageData(0, 0, columns, rows).data, columns, rows, expectedDisplayTime);
    };
    source.requestVideoFrameCallback(next);
  } else {
    const look = (gl) => {
      const [left, top, columns, rows] = boxOf(source.width, source.height);
      const bottom = source.height - top - rows;
      const rgba = new Uint8Array(4 * columns * rows);
      const bound = gl.getParameter(gl.FRAMEBUFFER_BINDING);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.readPixels(left, bottom, columns, rows, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
      gl.bindFramebuffer(gl.FRAMEBUFFER, bound);
      keep(rgba, columns, rows, performance.now());
      window.onDrawn.waits = false;
    };
    window.onDrawn = { canvas: source, look, waits: false };
  }
}"""


def listen(page: Page) -> None:
    """Have `page` keep what it plays from when it is opened on."""
    page.add_init_script(f"const METER = {json.dumps(_METER_ADDRESS)};{_LISTEN}")


def watch(page: Page, selector: str, box: Box) -> None:
    """Have `page` keep the part `box` of each picture that the element `selector` shows."""
    page.evaluate(_WATCH, [selector, box])


def witnessed(page: Page, seconds: float) -> tuple[Sound, Shown]:
    """What `page` plays and shows for so long."""
    page.evaluate("() => { heard.length = 0; seen.length = 0; }")
    page.wait_for_timeout(1e3 * seconds)
    heard = np.array(page.evaluate("() => heard"), np.float64).reshape(-1, 3)
    times, columns, rows, pictures = page.evaluate(
        """() => [0, 1, 2].map((at) => seen.map((one) => one[at]))
            .concat([seen.map((one) => btoa(one[3]))])"""
    )
    # one offset for all: each of its own holds how late its message was read
    ordered = heard[np.argsort(heard[:, 0], kind="stable")]
    played = Sound(1e-3 * (ordered[:, 0] + np.median(ordered[:, 2])), ordered[:, 1])
    shown = [
        cv2.resize(
            np.frombuffer(base64.b64decode(text), np.uint8).reshape(h, w), (SIDE_PX, SIDE_PX)
        )
        for text, w, h in zip(pictures, columns, rows, strict=True)
    ]
    return played, Shown(1e-3 * np.array(times), np.array(shown, np.float32))
