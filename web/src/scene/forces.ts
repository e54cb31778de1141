// Contact forces as arrows that end where they act.
import {
  BufferGeometry,
  ConeGeometry,
  CylinderGeometry,
  Group,
  InstancedMesh,
  Matrix4,
  MeshBasicMaterial,
  Quaternion,
  Vector3,
} from "three";
import type { Contact } from "../playback";

const MOST_ARROWS = 64;
const HEAD_SHARE = 0.3;
const UP = new Vector3(0, 0, 1);

export class Forces {
  readonly group = new Group();
  private readonly material = new MeshBasicMaterial({ depthTest: false, transparent: true });
  private readonly shafts: InstancedMesh;
  private readonly heads: InstancedMesh;
  private readonly largest_n: number;

  /** Arrows for a scene of a size: the largest force has a 5th of it. */
  constructor(
    contacts: readonly Contact[],
    private readonly size_m: number,
  ) {
    this.largest_n = contacts.reduce((most, one) => Math.max(most, Math.hypot(...one.force_n)), 0);
    const shaft = new CylinderGeometry(0.012, 0.012, 1 - HEAD_SHARE, 10).rotateX(Math.PI / 2);
    const head = new ConeGeometry(0.045, HEAD_SHARE, 16).rotateX(Math.PI / 2);
    this.shafts = this.instances(shaft.translate(0, 0, (1 - HEAD_SHARE) / 2));
    this.heads = this.instances(head.translate(0, 0, 1 - HEAD_SHARE / 2));
    this.group.add(this.shafts, this.heads);
    this.group.renderOrder = 1;
  }

  recolour(colour: string): void {
    this.material.color.set(colour);
  }

  /** Shows these contacts; of too many the first ones. */
  update(contacts: readonly Contact[]): void {
    const shown = contacts.slice(0, MOST_ARROWS);
    shown.forEach((contact, index) => {
      const force = new Vector3(...contact.force_n);
      // A root, so that small forces are seen beside large ones.
      const share = this.largest_n > 0 ? Math.sqrt(force.length() / this.largest_n) : 0;
      const length_m = Math.max(share, 0.08) * this.size_m * 0.2;
      const direction = force.lengthSq() > 0 ? force.normalize() : UP;
      const turn = new Quaternion().setFromUnitVectors(UP, direction);
      const tail = new Vector3(...contact.position_m).addScaledVector(direction, -length_m);
      const width = Math.max(length_m, this.size_m * 0.06);
      const matrix = new Matrix4().compose(tail, turn, new Vector3(width, width, length_m));
      this.shafts.setMatrixAt(index, matrix);
      this.heads.setMatrixAt(index, matrix);
    });
    for (const instances of [this.shafts, this.heads]) {
      instances.count = shown.length;
      instances.instanceMatrix.needsUpdate = true;
    }
  }

  private instances(geometry: BufferGeometry): InstancedMesh {
    const made = new InstancedMesh(geometry, this.material, MOST_ARROWS);
    made.count = 0;
    made.frustumCulled = false;
    made.renderOrder = 1;
    return made;
  }
}
