// The scrub bar, with a mark for each skill.
import { clockText, skillText } from "../plan";
import type { Playback } from "../playback";
import { make } from "./elements";

const STEPS = 1000;
const ARM_COLOURS = 6;

export class Timeline {
  readonly element: HTMLElement;
  private readonly input: HTMLInputElement;
  private readonly marks: HTMLElement[];

  constructor(
    private readonly playback: Playback,
    private readonly seek: (time_s: number) => void,
  ) {
    this.input = make("input", {
      type: "range",
      min: "0",
      max: String(STEPS),
      step: "1",
      value: "0",
      "aria-label": "Time",
    });
    this.input.addEventListener("input", () =>
      this.seek((Number(this.input.value) / STEPS) * playback.duration_s),
    );
    const rows = Math.max(1, playback.arms.length);
    const lanes = make("div", { class: "player-marks", "aria-hidden": "true" });
    lanes.style.setProperty("--player-lanes", String(rows));
    this.marks = playback.skills.map((_, index) => this.mark(index));
    lanes.append(...this.marks);
    this.element = make("div", { class: "player-timeline" }, this.input, lanes);
  }

  /** Shows a time, and which skills run. */
  update(time_s: number, running: readonly number[], words: string): void {
    const { duration_s } = this.playback;
    const share = duration_s > 0 ? time_s / duration_s : 0;
    this.input.value = String(Math.round(share * STEPS));
    this.input.style.setProperty("--player-share", `${(share * 100).toFixed(2)}%`);
    const at = `${clockText(time_s)} of ${clockText(duration_s)}`;
    this.input.setAttribute("aria-valuetext", words ? `${at}, ${words}` : at);
    this.marks.forEach((mark, index) =>
      mark.classList.toggle("player-mark-current", running.includes(index)),
    );
  }

  private mark(index: number): HTMLElement {
    const { skills, arms, duration_s } = this.playback;
    const skill = skills[index];
    const mark = make("span", { class: "player-mark" });
    if (!skill || duration_s <= 0) return mark;
    const lane = Math.max(
      0,
      arms.findIndex((arm) => arm.name === skill.arm),
    );
    mark.title = `${skillText(skills, index, arms.length)}, ${clockText(skill.start_s)}`;
    mark.dataset["arm"] = String(lane % ARM_COLOURS);
    mark.style.left = `${(skill.start_s / duration_s) * 100}%`;
    mark.style.width = `${((skill.end_s - skill.start_s) / duration_s) * 100}%`;
    mark.style.top = `${(lane / Math.max(1, arms.length)) * 100}%`;
    mark.addEventListener("click", () => this.seek(skill.start_s));
    return mark;
  }
}
