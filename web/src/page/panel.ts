// Buttons, time and words under the picture.
import { clockText, skillText } from "../plan";
import type { Contact, Playback } from "../playback";
import type { Shown } from "../scene/picture";
import { SPEEDS, type Transport } from "../transport";
import { button, icon, make } from "./elements";
import { Timeline } from "./timeline";

type Switch = "labels" | "ghosts" | "forces" | "paths";
const SWITCHES: readonly (readonly [Switch, string, string, string])[] = [
  ["labels", "Labels", "Labels", "L"],
  ["ghosts", "Goals", "Ghosts of the goal", "G"],
  ["forces", "Forces", "Contact forces", "C"],
  ["paths", "Paths", "Paths", "T"],
];
// What a screen reader says, at most this often.
const SPEECH_GAP_MS = 1000;

/** What the buttons and keys do. */
export interface Actions {
  playOrPause(): void;
  previous(): void;
  next(): void;
  seek(time_s: number): void;
  setSpeed(speed: number): void;
  toggle(what: Switch): void;
  follow(arm: number | null): void;
  resetView(): void;
  theme(): void;
  help(): void;
}

export class Panel {
  readonly element: HTMLElement;
  private readonly timeline: Timeline;
  private readonly playButton: HTMLButtonElement;
  private readonly clock = make("output", { class: "player-clock", "aria-live": "off" });
  private readonly now = make("p", { class: "player-now", "aria-hidden": "true" });
  private readonly spoken = make("p", { class: "player-spoken", role: "status" });
  private readonly force = make("span", { class: "player-force" });
  private readonly speed: HTMLSelectElement;
  private readonly switches = new Map<Switch, HTMLButtonElement>();
  private readonly arm: HTMLSelectElement;
  private said = "";
  private saidAt_ms = -Infinity;

  constructor(
    private readonly playback: Playback,
    actions: Actions,
    with3d: boolean,
  ) {
    this.timeline = new Timeline(playback, actions.seek);
    this.playButton = button(icon("play"), "Play", "k", actions.playOrPause);
    this.playButton.classList.add("player-play");
    this.speed = this.speeds(actions);
    this.arm = this.arms(actions);
    const transport = make(
      "div",
      { class: "player-transport", role: "group", "aria-label": "Playback" },
      button(icon("previous"), "Previous skill", "p", actions.previous),
      this.playButton,
      button(icon("next"), "Next skill", "n", actions.next),
      this.clock,
      this.speed,
    );
    const view = make("div", { class: "player-switches", role: "group", "aria-label": "View" });
    if (with3d) view.append(...this.viewButtons(actions));
    view.append(
      button("Dark/light", "Dark or light", "d", actions.theme),
      button("Keys", "Keys of the playback", "?", actions.help),
    );
    const bar = make("div", { class: "player-bar" }, transport, view);
    const line = make("div", { class: "player-line" }, this.now, this.force);
    this.element = make(
      "div",
      { class: "player-panel" },
      line,
      this.timeline.element,
      bar,
      this.spoken,
    );
  }

  update(transport: Transport, running: readonly number[], shown: Shown): void {
    const { skills, arms, duration_s } = this.playback;
    const words = running.map((index) => skillText(skills, index, arms.length)).join(" · ");
    const { time_s, playing } = transport;
    this.now.textContent = words || (time_s > 0 ? "between skills" : this.playback.title);
    this.timeline.update(time_s, running, words);
    this.clock.textContent = `${clockText(time_s)} / ${clockText(duration_s)}`;
    this.speed.value = String(transport.speed);
    const label = playing ? "Pause" : "Play";
    if (this.playButton.getAttribute("aria-label") !== label) {
      this.playButton.setAttribute("aria-label", label);
      this.playButton.title = `${label} (k)`;
      this.playButton.replaceChildren(icon(playing ? "pause" : "play"));
    }
    for (const [name, made] of this.switches)
      made.setAttribute("aria-pressed", String(shown[name]));
    this.arm.value = shown.followed === null ? "" : String(shown.followed);
    this.say(words, playing);
  }

  /** Says how strong the contacts in the picture are. */
  showForces(contacts: readonly Contact[]): void {
    let text = "";
    let most_n = -1;
    for (const contact of contacts) {
      const force_n = Math.hypot(...contact.force_n);
      if (force_n <= most_n) continue;
      most_n = force_n;
      text = `${force_n.toFixed(1)} N, ${contact.bodies.join(" on ")}`;
    }
    this.force.textContent = text;
  }

  private say(words: string, playing: boolean): void {
    const at_ms = performance.now();
    if (words === this.said || (playing && at_ms - this.saidAt_ms < SPEECH_GAP_MS)) return;
    this.said = words;
    this.saidAt_ms = at_ms;
    this.spoken.textContent = words;
  }

  private speeds(actions: Actions): HTMLSelectElement {
    const select = make("select", { "aria-label": "Speed", title: "Speed (< >)" });
    for (const speed of SPEEDS) {
      select.append(make("option", { value: String(speed) }, `${speed}×`));
    }
    select.addEventListener("change", () => actions.setSpeed(Number(select.value)));
    return select;
  }

  private arms(actions: Actions): HTMLSelectElement {
    const select = make("select", { "aria-label": "Follow an arm", title: "Follow an arm (F)" });
    select.append(make("option", { value: "" }, "Follow: off"));
    this.playback.arms.forEach((arm, index) =>
      select.append(make("option", { value: String(index) }, `Follow: ${arm.name}`)),
    );
    select.addEventListener("change", () =>
      actions.follow(select.value === "" ? null : Number(select.value)),
    );
    return select;
  }

  private viewButtons(actions: Actions): HTMLElement[] {
    const has: Record<Switch, boolean> = {
      labels: this.playback.bodies.some((body) => body.label),
      ghosts: this.playback.bodies.some((body) => body.goal),
      forces: this.playback.contacts.length > 0,
      paths: this.playback.paths.length > 0,
    };
    const made: HTMLElement[] = [];
    for (const [name, face, label, key] of SWITCHES) {
      if (!has[name]) continue;
      const one = button(face, label, key.toLowerCase(), () => actions.toggle(name));
      one.setAttribute("aria-pressed", "true");
      this.switches.set(name, one);
      made.push(one);
    }
    if (this.playback.arms.length > 0) made.push(this.arm);
    made.push(button("First view", "First view again", "r", actions.resetView));
    return made;
  }
}
