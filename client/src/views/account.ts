/** Who is signed in, and the ways in and out, where the server has a provider to sign in at. */

import type { Problem } from "../api/problem";
import type { Access } from "../api/types";
import { h } from "./dom";
import { button, notice, type View } from "./shell";

interface AccountHooks {
  onSignIn(): void;
  onSignOut(): void;
}

/** For the head of the page; `name` is null for whoever has not signed in, empty where the provider tells none. */
export function accountControl(access: Promise<Access>, name: string | null, hooks: AccountHooks): HTMLElement {
  const element = h("div", { className: "account", testId: "account" });
  void access.then(({ login }) => {
    if (!login) return;
    if (name === null) element.append(button("Sign in", hooks.onSignIn, { testId: "sign-in" }));
    else element.append(h("span", { className: "account-name" }, name || "Signed in"), button("Sign out", hooks.onSignOut, { testId: "sign-out" }));
  });
  return element;
}

/** In place of a page that takes an account; `problem` is what kept one from it, `onGuest` the way on without. */
export function signInView(problem: Problem | null, onSignIn: () => void, onGuest: (() => void) | null): View {
  const ways = [
    button("Sign in", onSignIn, { look: "primary", large: problem === null, testId: "sign-in-here" }),
    onGuest && button("Go on as a guest", onGuest, { testId: "as-guest" }),
  ];
  const element = problem
    ? h("main", { className: "problem-screen" }, notice(problem, ...ways))
    : h(
        "main",
        { className: "problem-screen" },
        h("h1", { tabIndex: -1 }, "Sign in to meet"),
        h("p", { className: "lead" }, "This server is for people with an account. You come back to this page afterwards."),
        h("div", { className: "actions" }, ...ways.filter((way) => way !== null)),
      );
  return { element, close: () => undefined };
}
