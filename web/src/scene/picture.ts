// The 3-D picture of a playback at a time.
import { Vector3, type WebGLRenderer } from "three";
import type { Motion } from "../motion";
import { contactsBetween, runningAt } from "../plan";
import type { Contact, Playback } from "../playback";
import { paletteOf } from "../theme";
import { Bodies } from "./bodies";
import { Forces } from "./forces";
import { Labels } from "./labels";
import { Paths } from "./paths";
import { Stage } from "./stage";

/** What a viewer may switch. */
export interface Shown {
  labels: boolean;
  ghosts: boolean;
  forces: boolean;
  paths: boolean;
  /** The arm whose tip the camera follows, or null. */
  followed: number | null;
}

export class Picture {
  readonly stage: Stage;
  private readonly bodies: Bodies;
  private readonly forces: Forces;
  private readonly paths: Paths;
  private readonly labels: Labels;
  private tip: Vector3 | null = null;
  private followed: number | null = null;

  constructor(
    private readonly playback: Playback,
    private readonly motion: Motion,
    renderer: WebGLRenderer,
    private readonly canvas: HTMLCanvasElement,
    labelLayer: HTMLElement,
    changed: () => void,
  ) {
    this.bodies = new Bodies(playback, motion);
    this.bodies.update(0, new Set());
    const points = playback.paths.flatMap((path) => path.points_m);
    const bounds = this.bodies.bounds(points);
    this.stage = new Stage(renderer, bounds, playback.view, changed);
    this.forces = new Forces(playback.contacts, bounds.getSize(new Vector3()).length());
    this.paths = new Paths(playback.paths);
    this.labels = new Labels(labelLayer);
    this.stage.scene.add(this.bodies.group, this.forces.group, this.paths.group);
    this.recolour();
  }

  recolour(): void {
    const palette = paletteOf(this.canvas);
    this.stage.recolour(palette);
    this.bodies.recolour(palette);
    this.forces.recolour(palette.force);
    this.paths.recolour(palette);
  }

  /** Draws a time; returns the contacts that it shows. */
  draw(time_s: number, shown: Shown): readonly Contact[] {
    const { skills, contacts, frames_per_s } = this.playback;
    const running = runningAt(skills, time_s).map((index) => skills[index]?.subject);
    const subjects = new Set(running.filter((name) => typeof name === "string"));
    this.bodies.ghostsShown = shown.ghosts;
    this.bodies.update(time_s, subjects);
    const half_s = 0.5 / frames_per_s;
    const acting = contactsBetween(contacts, time_s - half_s, time_s + half_s);
    this.forces.group.visible = shown.forces;
    this.forces.update(acting);
    this.paths.group.visible = shown.paths;
    this.follow(time_s, shown.followed);
    this.stage.render();
    if (shown.labels) this.labels.update(this.bodies.labelPlaces(), this.stage.camera, subjects);
    else this.labels.hide();
    return acting;
  }

  private follow(time_s: number, arm: number | null): void {
    const track = arm === null ? undefined : this.playback.arms[arm]?.tip_track;
    const pose = track === undefined ? null : this.motion.pose(track, time_s);
    const tip = pose && new Vector3(pose[0], pose[1], pose[2]);
    if (tip) {
      const from = this.followed === arm && this.tip ? this.tip : this.stage.controls.target;
      this.stage.shift(tip.clone().sub(from));
    }
    this.tip = tip;
    this.followed = arm;
    this.stage.controls.update();
  }
}
