import { describe, expect, it, vi } from "vitest";
import { PerformerRoster } from "../../src/drawing/performerRoster";
import type { Meeting, Performer } from "../../src/api/types";
import { FRONT, performer } from "../viewpoint/front";
import { eventually } from "../waiting";

const [ADA, BO] = [performer("ada"), performer("bo")];

function roster(shown: Performer[], token = "seat") {
  const meeting = { id: "m", performers: [ADA, BO], viewpoint: FRONT, join_url: "/old" } as unknown as Meeting;
  const asked = vi.fn(async () => ({ ...meeting, performers: shown, join_url: "/new" }) as Meeting);
  const news: string[] = [];
  const made = new PerformerRoster({ meeting: asked }, meeting, {
    token: () => token,
    onPerformers: (performers) => news.push(`shown ${performers.map(({ id }) => id).join()}`),
    onGone: (gone) => news.push(`gone ${gone.map(({ id }) => id).join()}`),
    onEnvironment: () => undefined,
  });
  return { made, meeting, asked, news };
}

describe("who is shown", () => {
  it("drops whoever the server shows no longer before anything is asked for", async () => {
    const { made, meeting, asked, news } = roster([BO]);
    made.showOnly(["bo"]);
    expect(news).toEqual(["gone ada", "shown bo"]);
    expect(meeting.performers).toEqual([BO]);
    await eventually(() => expect(asked).toHaveBeenCalledWith("m", "seat"));
    await eventually(() => expect(meeting.join_url).toBe("/new"));
    made.showOnly(["bo"]);
    expect([asked.mock.calls.length, news.length]).toEqual([1, 3]);
  });

  it("drops the last one too", () => {
    const { made, news } = roster([]);
    made.showOnly([]);
    expect(news).toEqual(["gone ada,bo", "shown "]);
  });

  it("asks for whoever came, and for nothing where all is known", async () => {
    const { made, asked, news } = roster([ADA, BO, performer("cy")]);
    made.showOnly(["ada", "bo"]);
    expect(asked).not.toHaveBeenCalled();
    made.showOnly(["ada", "bo", "cy"]);
    await eventually(() => expect(news).toEqual(["shown ada,bo,cy"]));
  });

  it("asks nothing without a seat", async () => {
    const { made, asked } = roster([], "");
    await made.refresh();
    expect(asked).not.toHaveBeenCalled();
  });
});
