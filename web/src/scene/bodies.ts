// Links, parts, tools, docks, feeders and what surrounds them, each where it is at a time.
import {
  Box3,
  Color,
  DoubleSide,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  Object3D,
  Vector3,
} from "three";
import type { Motion } from "../motion";
import type { Body, Kind, Playback, Pose, Vector } from "../playback";
import type { Palette } from "../theme";
import { Geometries } from "./geometry";

/** How a kind of body reflects: roughness and metalness. */
const FINISH: Partial<Record<Kind, readonly [number, number]>> = {
  link: [0.45, 0.05],
  tool: [0.5, 0.25],
  head: [0.5, 0.25],
  screw: [0.35, 0.5],
};
const PLAIN = [0.8, 0] as const;
const CASTS_NO_SHADOW: readonly Kind[] = ["environment", "sheet", "zone"];
const SHEET_OPACITY = 0.55;
const ZONE_OPACITY = 0.16;
const GHOST_OPACITY = 0.13;
const NEXT_GHOST_OPACITY = 0.38;
// A part closer to its goal than this needs no ghost there.
const AT_GOAL_M = 0.0015;
// What surrounds the cell and is larger than this many times the rest is no part of the first view.
const SURROUNDINGS = 2;

interface Drawn {
  readonly body: Body;
  readonly group: Group;
  readonly ghost: Group | null;
  readonly materials: readonly MeshStandardMaterial[];
}

function place(object: Object3D, pose: Pose): void {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
}

export class Bodies {
  readonly group = new Group();
  ghostsShown = true;
  private readonly drawn: Drawn[];
  private readonly edges = new LineBasicMaterial({ transparent: true, opacity: 0.45 });
  private readonly ghost = ghostMaterial(GHOST_OPACITY);
  private readonly nextGhost = ghostMaterial(NEXT_GHOST_OPACITY);
  private readonly geometries: Geometries;

  constructor(
    playback: Playback,
    private readonly motion: Motion,
  ) {
    this.geometries = new Geometries(playback);
    this.drawn = playback.bodies.map((body) => this.draw(body));
  }

  /** Moves all bodies to a time; the ghosts of `subjects` stand out. */
  update(time_s: number, subjects: ReadonlySet<string>): void {
    for (const { body, group, ghost } of this.drawn) {
      const pose = body.track === null ? body.pose : this.motion.pose(body.track, time_s);
      group.visible = pose !== null;
      if (pose) place(group, pose);
      if (!ghost) continue;
      const arrived = pose !== null && ghost.position.distanceTo(group.position) < AT_GOAL_M;
      ghost.visible = this.ghostsShown && !arrived;
      const material = subjects.has(body.name) ? this.nextGhost : this.ghost;
      for (const child of ghost.children) if (child instanceof Mesh) child.material = material;
    }
  }

  recolour(palette: Palette): void {
    this.edges.color.set(palette.edge);
    this.ghost.color.set(palette.ghost);
    this.nextGhost.color.set(palette.ghost);
    for (const { body, materials } of this.drawn) {
      for (const material of materials)
        material.color = new Color(body.color ?? palette[body.kind]);
    }
  }

  /** The top of each labelled body that is there, by name. */
  labelPlaces(): Map<string, Vector3> {
    const places = new Map<string, Vector3>();
    for (const { body, group } of this.drawn) {
      if (!body.label || !group.visible) continue;
      const box = new Box3().setFromObject(group);
      const top = box.isEmpty() ? group.position.clone() : box.getCenter(new Vector3());
      if (!box.isEmpty()) top.z = box.max.z;
      places.set(body.name, top);
    }
    return places;
  }

  /** A box round all that the first view should show. */
  bounds(points: readonly Vector[]): Box3 {
    this.group.updateMatrixWorld(true);
    const inner = new Box3();
    for (const { body, group, ghost } of this.drawn) {
      if (body.kind === "environment" || body.kind === "zone") continue;
      if (group.visible) inner.expandByObject(group);
      if (ghost) inner.expandByObject(ghost);
    }
    for (const point of points) inner.expandByPoint(new Vector3(...point));
    for (const { body, group } of this.drawn) {
      if (body.kind !== "environment") continue;
      const box = new Box3().setFromObject(group);
      const size = box.getSize(new Vector3()).length();
      if (inner.isEmpty() || size < SURROUNDINGS * inner.getSize(new Vector3()).length()) {
        inner.union(box);
      }
    }
    return inner.isEmpty() ? new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1)) : inner;
  }

  private draw(body: Body): Drawn {
    const [roughness, metalness] = FINISH[body.kind] ?? PLAIN;
    const material = new MeshStandardMaterial({ roughness, metalness });
    if (body.kind === "sheet") {
      material.transparent = true;
      material.opacity = SHEET_OPACITY;
    }
    if (body.kind === "zone") {
      // What is inside stays visible, from all sides.
      material.transparent = true;
      material.opacity = ZONE_OPACITY;
      material.depthWrite = false;
      material.side = DoubleSide;
    }
    const group = new Group();
    group.name = body.name;
    this.addShapes(group, body, material, body.kind !== "link");
    place(group, body.pose);
    group.traverse((object) => {
      object.receiveShadow = true;
      object.castShadow = object instanceof Mesh && !CASTS_NO_SHADOW.includes(body.kind);
    });
    let ghost: Group | null = null;
    if (body.goal) {
      ghost = new Group();
      this.addShapes(ghost, body, this.ghost, true);
      place(ghost, body.goal);
      this.group.add(ghost);
    }
    this.group.add(group);
    return { body, group, ghost, materials: [material] };
  }

  private addShapes(
    group: Group,
    body: Body,
    material: MeshStandardMaterial,
    edged: boolean,
  ): void {
    for (const shape of body.shapes) {
      const { geometry, edges, scale } = this.geometries.of(shape);
      const objects: Object3D[] = [new Mesh(geometry, material)];
      if (edges && edged) objects.push(new LineSegments(edges, this.edges));
      for (const object of objects) {
        place(object, shape.pose);
        object.scale.copy(scale);
        group.add(object);
      }
    }
  }
}

function ghostMaterial(opacity: number): MeshStandardMaterial {
  return new MeshStandardMaterial({ transparent: true, opacity, depthWrite: false, roughness: 1 });
}
