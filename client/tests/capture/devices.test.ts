import { afterEach, describe, expect, it, vi } from "vitest";
import { storeDevices, chosenDevices, loudness, microphoneProblem, openMicrophone } from "../../src/capture/devices";

function store(text: string | null = null) {
  return { getItem: () => text, setItem: (_: string, value: string) => void (text = value) };
}

describe("the choice of devices", () => {
  it("is remembered, each by itself", () => {
    const kept = store();
    expect(chosenDevices(kept)).toEqual({ camera: "", microphone: "", joinUnmuted: false });
    storeDevices({ camera: "a" }, kept);
    storeDevices({ joinUnmuted: true }, kept);
    expect(chosenDevices(kept)).toEqual({ camera: "a", microphone: "", joinUnmuted: true });
  });

  it("survives what another release wrote", () => {
    expect(chosenDevices(store("{broken"))).toMatchObject({ microphone: "" });
  });
});

describe("openMicrophone", () => {
  afterEach(() => vi.unstubAllGlobals());

  it("asks for the one of one's choice, and takes another where that is gone", async () => {
    const asked: unknown[] = [];
    const kept = store(JSON.stringify({ microphone: "m2" }));
    vi.stubGlobal("localStorage", kept);
    vi.stubGlobal("navigator", { mediaDevices: { getUserMedia: async (wanted: unknown) => void asked.push(wanted) } });
    await openMicrophone();
    expect(asked).toMatchObject([{ audio: { deviceId: { ideal: "m2" }, echoCancellation: true } }]);
  });

  it("says in words what to do, and that one may join without", async () => {
    vi.stubGlobal("navigator", { mediaDevices: { getUserMedia: () => Promise.reject(new DOMException("", "NotAllowedError")) } });
    await expect(openMicrophone()).rejects.toMatchObject({
      title: "The microphone is blocked",
      detail: expect.stringContaining("join without"),
    });
    vi.stubGlobal("navigator", {});
    await expect(openMicrophone()).rejects.toMatchObject({ title: "The microphone is blocked" });
    expect(microphoneProblem("NotFoundError").title).toBe("No microphone found");
    expect(microphoneProblem("NotReadableError").title).toBe("The microphone is busy");
  });
});

describe("loudness", () => {
  it("goes from silence to full scale in decibels", () => {
    expect(loudness(new Float32Array(64))).toBe(0);
    expect(loudness(new Float32Array(64).fill(1))).toBe(1);
    expect(loudness(new Float32Array(64).fill(0.0316))).toBeCloseTo(0.5, 2);
  });
});
