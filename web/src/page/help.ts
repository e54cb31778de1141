// What keys do, as a list that a key opens.
import { make } from "./elements";

export const KEYS: readonly (readonly [string, string])[] = [
  ["Space or K", "play, pause"],
  ["← →", "a second back, on (with Shift: a frame)"],
  ["P N", "previous, next skill"],
  ["Home End", "to the beginning, to the end"],
  ["< >", "slower, faster"],
  ["L", "labels"],
  ["G", "ghosts of the goal"],
  ["C", "contact forces"],
  ["T", "paths"],
  ["F", "follow the arm"],
  ["R", "first view again"],
  ["D", "dark or light"],
  ["?", "this list"],
  ["Arrow keys in the picture", "orbit (with Shift: move)"],
  ["+ −", "nearer, farther"],
];

/** Makes the list as a dialog; Escape closes it. */
export function helpDialog(): HTMLDialogElement {
  const rows = KEYS.map(([key, does]) =>
    make("tr", {}, make("th", { scope: "row" }, key), make("td", {}, does)),
  );
  const close = make("button", { type: "submit" }, "Close");
  const mouse = "Drag to orbit, drag with the right button to move; once clicked, the wheel zooms.";
  return make(
    "dialog",
    { class: "player-help", "aria-label": "Keys of the playback" },
    make("h2", {}, "Keys of the playback"),
    make("p", {}, "They work while the focus is in the player."),
    make("table", {}, make("tbody", {}, ...rows)),
    make("p", {}, mouse),
    make("form", { method: "dialog" }, close),
  );
}
