import { describe, expect, it } from "vitest";
import { SseParser, readEvents, type ServerEvent } from "../../src/api/sse";

describe("SseParser", () => {
  const TEXT =
    ': hello\n\nevent: progress\ndata: {"a":1}\n\nid: 7\nretry: 10\ndata:two\ndata: lines\n\nevent: end\n\n';
  const EVENTS = [
    { event: "progress", data: '{"a":1}' },
    { event: "message", data: "two\nlines" },
  ];

  it("reads fields, comments and events without data as the standard says", () => {
    expect(new SseParser().push(TEXT)).toEqual(EVENTS);
  });

  it.each(["\n", "\r\n", "\r"])("reads text cut at any place, with lines ended by %j", (end) => {
    const text = TEXT.replaceAll("\n", end);
    for (let size = 1; size < 9; size++) {
      const parser = new SseParser();
      const events: ServerEvent[] = [];
      for (let at = 0; at < text.length; at += size) {
        events.push(...parser.push(text.slice(at, at + size)));
      }
      expect(events).toEqual(EVENTS);
    }
  });
});

describe("readEvents", () => {
  const bytes = new TextEncoder().encode("data: Grüße\n\n");

  it("puts letters together that arrive in two halves", async () => {
    const body = new ReadableStream<Uint8Array>({
      start(controller) {
        for (const byte of bytes) controller.enqueue(Uint8Array.of(byte));
        controller.close();
      },
    });
    const events: ServerEvent[] = [];
    for await (const event of readEvents(body)) events.push(event);
    expect(events).toEqual([{ event: "message", data: "Grüße" }]);
  });

  it("closes the connection when nobody listens any more", async () => {
    let cancelled = false;
    const body = new ReadableStream<Uint8Array>({
      start: (controller) => controller.enqueue(bytes),
      cancel: () => {
        cancelled = true;
      },
    });
    for await (const event of readEvents(body)) {
      expect(event.data).toBe("Grüße");
      break;
    }
    expect(cancelled).toBe(true);
  });
});
