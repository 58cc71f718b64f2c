/** One's own performers, told apart by name and picture where there are several. */

import type { Api } from "../api/api";
import type { Performer } from "../api/types";
import { h } from "./dom";

/** Performers of our own people; for who brought none, those whose people let others move them. */
export function ownPerformers(performers: readonly Performer[]): Performer[] {
  const own = performers.filter(({ owner }) => owner === "own");
  return own.length > 0 ? own : performers.filter(({ drivable }) => drivable);
}

/** A button for each model, with a small picture of it as soon as the server has drawn that. */
export function modelButtons<Choice extends { name: string; modelId: string }>(
  api: Api,
  models: readonly Choice[],
  onChoice: (model: Choice) => void,
): HTMLElement {
  const buttons = models.map((model) => {
    const picture = h("img", { alt: "" });
    void showPicture(api, model.modelId, picture);
    const choice = h("button", { className: "model-choice", attributes: { type: "button" } }, picture, h("span", {}, model.name));
    choice.addEventListener("click", () => onChoice(model));
    return choice;
  });
  return h("div", { className: "model-choices", testId: "model-choices" }, ...buttons);
}

async function showPicture(api: Api, modelId: string, picture: HTMLImageElement): Promise<void> {
  // without its picture a model still has its name
  const drawn = await api.modelPicture(modelId).catch(() => null);
  if (!drawn) return;
  picture.addEventListener("load", () => URL.revokeObjectURL(picture.src), { once: true });
  picture.src = URL.createObjectURL(drawn);
}
