// Geometries of shapes: unit solids that are scaled, and meshes with normals that keep edges sharp.
import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  EdgesGeometry,
  SphereGeometry,
  Vector3,
} from "three";
import { indicesOf, int16Of } from "../decode";
import type { Mesh, Playback, Shape } from "../playback";

// Faces that meet at less than this look like one surface.
const CREASE_COSINE = Math.cos((38 * Math.PI) / 180);
const EDGE_DEG = 30;
// Of a coordinate of 16 bits.
const SHIFT = 0x8000;
const RANGE = 0x10000;

export interface Solid {
  readonly geometry: BufferGeometry;
  /** Lines along its edges, for shapes that have few. */
  readonly edges: BufferGeometry | null;
  readonly scale: Vector3;
}

/** Triangle corners in a row, with a normal each; vertices are the same where their steps are. */
export function creased(
  steps: Int16Array,
  positions: Float32Array,
  triangles: ArrayLike<number>,
): BufferGeometry {
  const faces = triangles.length / 3;
  const corners = welded(steps);
  const normals = new Float32Array(faces * 3);
  const touching: number[][] = [];
  const [a, b, c] = [new Vector3(), new Vector3(), new Vector3()];
  for (let face = 0; face < faces; face++) {
    const at = (corner: number) => triangles[face * 3 + corner] ?? 0;
    a.fromArray(positions, at(0) * 3);
    b.fromArray(positions, at(1) * 3).sub(a);
    c.fromArray(positions, at(2) * 3).sub(a);
    b.cross(c).toArray(normals, face * 3);
    for (let corner = 0; corner < 3; corner++) {
      (touching[corners[at(corner)] ?? 0] ??= []).push(face);
    }
  }
  const points = new Float32Array(faces * 9);
  const shading = new Float32Array(faces * 9);
  const [own, other, sum] = [new Vector3(), new Vector3(), new Vector3()];
  for (let index = 0; index < faces * 3; index++) {
    const vertex = triangles[index] ?? 0;
    own.fromArray(normals, Math.floor(index / 3) * 3);
    sum.set(0, 0, 0);
    for (const face of touching[corners[vertex] ?? 0] ?? []) {
      other.fromArray(normals, face * 3);
      const limit = CREASE_COSINE * Math.sqrt(own.lengthSq() * other.lengthSq());
      if (own.dot(other) >= limit) sum.add(other);
    }
    sum.normalize().toArray(shading, index * 3);
    points.set(positions.subarray(vertex * 3, vertex * 3 + 3), index * 3);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(points, 3));
  geometry.setAttribute("normal", new BufferAttribute(shading, 3));
  return geometry;
}

/** For each vertex the first one that stands at the same place. */
function welded(steps: Int16Array): Uint32Array {
  const first = new Map<number, number>();
  const found = new Uint32Array(steps.length / 3);
  for (let vertex = 0; vertex < found.length; vertex++) {
    const [x = 0, y = 0, z = 0] = steps.subarray(vertex * 3, vertex * 3 + 3);
    // Whole numbers of 48 bits.
    const key = ((x + SHIFT) * RANGE + (y + SHIFT)) * RANGE + (z + SHIFT);
    const known = first.get(key) ?? vertex;
    first.set(key, known);
    found[vertex] = known;
  }
  return found;
}

function meshGeometry(mesh: Mesh): BufferGeometry {
  const steps = int16Of(mesh.positions);
  const positions = new Float32Array(steps.length);
  for (let index = 0; index < steps.length; index++) {
    const offset = mesh.offset_m[index % 3] ?? 0;
    positions[index] = offset + mesh.scale_m * (steps[index] ?? 0);
  }
  return creased(steps, positions, indicesOf(mesh.triangles, mesh.wide));
}

/** Makes each geometry once, for bodies and ghosts alike. */
export class Geometries {
  private readonly box = new BoxGeometry();
  private readonly boxEdges = new EdgesGeometry(this.box);
  private readonly cylinder = new CylinderGeometry(1, 1, 1, 40).rotateX(Math.PI / 2);
  private readonly cylinderEdges = new EdgesGeometry(this.cylinder, EDGE_DEG);
  private readonly sphere = new SphereGeometry(1, 32, 20);
  private readonly meshes = new Map<number, BufferGeometry>();

  constructor(private readonly playback: Playback) {}

  /** The solid of a shape. */
  of(shape: Shape): Solid {
    switch (shape.type) {
      case "box":
        return { geometry: this.box, edges: this.boxEdges, scale: new Vector3(...shape.size_m) };
      case "cylinder": {
        const scale = new Vector3(shape.radius_m, shape.radius_m, shape.length_m);
        return { geometry: this.cylinder, edges: this.cylinderEdges, scale };
      }
      case "sphere": {
        const scale = new Vector3(shape.radius_m, shape.radius_m, shape.radius_m);
        return { geometry: this.sphere, edges: null, scale };
      }
      case "capsule": {
        const geometry = new CapsuleGeometry(shape.radius_m, shape.length_m, 10, 32);
        geometry.rotateX(Math.PI / 2);
        return { geometry, edges: null, scale: new Vector3(1, 1, 1) };
      }
      case "mesh":
        return { geometry: this.mesh(shape.mesh), edges: null, scale: new Vector3(1, 1, 1) };
    }
  }

  private mesh(index: number): BufferGeometry {
    const known = this.meshes.get(index);
    if (known) return known;
    const mesh = this.playback.meshes[index];
    if (!mesh) throw new Error(`the playback names mesh ${index}, and has none`);
    const made = meshGeometry(mesh);
    this.meshes.set(index, made);
    return made;
  }
}
