// Paths as lines.
import { BufferGeometry, Group, Line, LineBasicMaterial, Vector3 } from "three";
import type { Path } from "../playback";
import type { Palette } from "../theme";

export class Paths {
  readonly group = new Group();
  private readonly materials = {
    trajectory: new LineBasicMaterial(),
    tip: new LineBasicMaterial({ transparent: true, opacity: 0.8 }),
  };

  constructor(paths: readonly Path[]) {
    for (const path of paths) {
      const points = path.points_m.map((point) => new Vector3(...point));
      const geometry = new BufferGeometry().setFromPoints(points);
      this.group.add(new Line(geometry, this.materials[path.kind]));
    }
  }

  recolour(palette: Palette): void {
    this.materials.trajectory.color.set(palette["path-trajectory"]);
    this.materials.tip.color.set(palette["path-tip"]);
  }
}
