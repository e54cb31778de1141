// The player: one clock, the picture, the panel under it, and what the page shows elsewhere.
import { Motion } from "./motion";
import { make } from "./page/elements";
import { listenToPage, markSkills, showTime } from "./page/gantt";
import { helpDialog } from "./page/help";
import { listenToKeys } from "./page/keyboard";
import { type Actions, Panel } from "./page/panel";
import { printStills } from "./page/still";
import { nextStart, previousStart, runningAt } from "./plan";
import type { Playback, Pose } from "./playback";
import { Picture, type Shown } from "./scene/picture";
import { makeRenderer } from "./scene/stage";
import { onThemeChange, toggleTheme } from "./theme";
import { Transport } from "./transport";

const NO_WEBGL =
  "The 3-D picture needs WebGL, which this browser does not offer or has switched off. " +
  "Time, skills and the chart below work without it, and the page's tables hold the same plan.";

/** What scripts and tests of the page may use. */
export interface PlayerInterface {
  seek(time_s: number): void;
  time(): number;
  play(): void;
  pause(): void;
  poseOf(name: string): Pose | null;
  readonly webgl: boolean;
}

declare global {
  interface Window {
    skillplanPlayer?: PlayerInterface;
  }
}

export class Player implements PlayerInterface {
  private readonly motion: Motion;
  private readonly transport: Transport;
  private readonly panel: Panel;
  private readonly picture: Picture | null;
  private readonly canvas = make("canvas", { class: "player-canvas", tabindex: "0", role: "img" });
  private readonly layer = make("div", { class: "player-labels", "aria-hidden": "true" });
  private readonly help = helpDialog();
  private readonly shown: Shown = {
    labels: true,
    ghosts: true,
    forces: true,
    paths: true,
    followed: null,
  };
  private scheduled = false;
  private drawnAt_ms: number | null = null;
  private running = "";

  constructor(
    root: HTMLElement,
    private readonly playback: Playback,
  ) {
    this.motion = new Motion(playback);
    this.transport = new Transport(playback.duration_s, () => this.schedule());
    const view = make("div", { class: "player-view" }, this.canvas, this.layer);
    const section = make("section", { class: "player", "aria-label": "3-D playback of the plan" });
    const renderer = makeRenderer(this.canvas);
    this.panel = new Panel(playback, this.actions(), renderer !== null);
    const fallback = [...root.children].filter((child) => child.localName !== "noscript");
    section.append(view, this.panel.element, this.help);
    root.replaceChildren(section);
    if (renderer) {
      const draw = () => this.schedule();
      const { canvas, layer, motion } = this;
      this.picture = new Picture(playback, motion, renderer, canvas, layer, draw);
      this.describeScale(view, this.picture.stage.grid_m);
      this.watch(view, this.picture);
    } else {
      this.picture = null;
      view.classList.add("player-without-webgl");
      view.replaceChildren(make("p", { role: "note" }, NO_WEBGL), ...fallback);
    }
    listenToKeys(section, this.canvas, this.keys(), this.pictureKeys());
    listenToPage((time_s) => this.seek(time_s));
    window.skillplanPlayer = this;
    this.draw();
    document.documentElement.dataset["playerReady"] = "1";
  }

  get webgl(): boolean {
    return this.picture !== null;
  }

  seek(time_s: number): void {
    this.transport.seek(time_s);
  }

  time(): number {
    return this.transport.time_s;
  }

  play(): void {
    this.transport.play();
  }

  pause(): void {
    this.transport.pause();
  }

  /** The pose now of a body, or of the tip of an arm; null for neither and while it is not there. */
  poseOf(name: string): Pose | null {
    const body = this.playback.bodies.find((one) => one.name === name);
    if (body && body.track === null) return body.pose;
    const track = body?.track ?? this.playback.arms.find((arm) => arm.name === name)?.tip_track;
    return track === undefined ? null : this.motion.pose(track, this.transport.time_s);
  }

  private schedule(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame((now_ms) => {
      this.scheduled = false;
      const before_ms = this.drawnAt_ms ?? now_ms;
      this.drawnAt_ms = this.transport.playing ? now_ms : null;
      this.transport.advance((now_ms - before_ms) / 1000);
      this.draw();
    });
  }

  private draw(): void {
    const { time_s } = this.transport;
    const running = runningAt(this.playback.skills, time_s);
    this.panel.update(this.transport, running, this.shown);
    if (this.running !== running.join()) {
      this.running = running.join();
      markSkills(running);
    }
    if (this.picture) {
      const acting = this.picture.draw(time_s, this.shown);
      this.panel.showForces(this.shown.forces ? acting : []);
    }
    showTime(time_s, this.playback.duration_s);
  }

  private describeScale(view: HTMLElement, grid_m: number): void {
    const words = grid_m < 1 ? "Grid 10 cm, bold 1 m" : "Grid 1 m, bold 10 m";
    view.append(make("p", { class: "player-scale", "aria-hidden": "true" }, words));
    this.canvas.setAttribute(
      "aria-label",
      `3-D picture of ${this.playback.title}. Arrow keys orbit, plus and minus zoom.`,
    );
  }

  private watch(view: HTMLElement, picture: Picture): void {
    const { stage } = picture;
    const fit = () => {
      stage.resize(view.clientWidth, view.clientHeight);
      this.draw();
    };
    stage.resize(view.clientWidth, view.clientHeight);
    new ResizeObserver(fit).observe(view);
    onThemeChange(() => {
      picture.recolour();
      this.schedule();
    });
    this.canvas.addEventListener("focus", () => (stage.controls.enableZoom = true));
    this.canvas.addEventListener("blur", () => (stage.controls.enableZoom = false));
    printStills(this.canvas, () => {
      picture.recolour();
      this.draw();
    });
  }

  private actions(): Actions {
    const { skills, duration_s } = this.playback;
    return {
      playOrPause: () => (this.transport.playing ? this.pause() : this.play()),
      previous: () => this.seek(previousStart(skills, this.time())),
      next: () => this.seek(nextStart(skills, this.time(), duration_s)),
      seek: (time_s) => this.seek(time_s),
      setSpeed: (speed) => this.transport.setSpeed(speed),
      toggle: (what) => this.change(() => (this.shown[what] = !this.shown[what])),
      follow: (arm) => this.change(() => (this.shown.followed = arm)),
      resetView: () =>
        this.change(() => {
          this.shown.followed = null;
          this.picture?.stage.resetView();
        }),
      theme: toggleTheme,
      help: () => this.help.showModal(),
    };
  }

  private change(what: () => void): void {
    what();
    this.schedule();
  }

  private keys(): Record<string, (event: KeyboardEvent) => void> {
    const actions = this.actions();
    const { duration_s, frames_per_s } = this.playback;
    const step = (event: KeyboardEvent, sign: number) =>
      this.seek(this.time() + sign * (event.shiftKey ? 1 / frames_per_s : 1));
    return {
      " ": actions.playOrPause,
      k: actions.playOrPause,
      p: actions.previous,
      n: actions.next,
      arrowleft: (event) => step(event, -1),
      arrowright: (event) => step(event, 1),
      home: () => this.seek(0),
      end: () => this.seek(duration_s),
      "<": () => this.transport.changeSpeed(-1),
      ">": () => this.transport.changeSpeed(1),
      l: () => actions.toggle("labels"),
      g: () => actions.toggle("ghosts"),
      c: () => actions.toggle("forces"),
      t: () => actions.toggle("paths"),
      f: () => actions.follow(this.nextArm()),
      r: actions.resetView,
      d: actions.theme,
      "?": actions.help,
      "+": () => this.zoom(1),
      "=": () => this.zoom(1),
      "-": () => this.zoom(-1),
    };
  }

  private pictureKeys(): Record<string, (event: KeyboardEvent) => void> {
    const move = (right: number, up: number) => (event: KeyboardEvent) => {
      const stage = this.picture?.stage;
      if (event.shiftKey) stage?.pan(right, up);
      else stage?.orbit(right, up);
      this.schedule();
    };
    return {
      arrowleft: move(-1, 0),
      arrowright: move(1, 0),
      arrowup: move(0, 1),
      arrowdown: move(0, -1),
    };
  }

  private zoom(steps: number): void {
    this.picture?.stage.zoom(steps);
    this.schedule();
  }

  /** The arm to follow after the one that is followed: none after the last. */
  private nextArm(): number | null {
    const next = this.shown.followed === null ? 0 : this.shown.followed + 1;
    return next < this.playback.arms.length ? next : null;
  }
}
