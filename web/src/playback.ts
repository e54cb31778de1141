// The document that the page holds, as `skillplan report` writes it: m, s, rad, N; z up.

export type Vector = readonly [number, number, number];
/** Position and quaternion: x, y, z, qx, qy, qz, qw. */
export type Pose = readonly [number, number, number, number, number, number, number];

export const KINDS = [
  "part",
  "tool",
  "link",
  "dock",
  "feeder",
  "environment",
  "screw",
  "head",
  "base",
  "sheet",
  "zone",
] as const;
export type Kind = (typeof KINDS)[number];

export type Shape =
  | { readonly type: "box"; readonly size_m: Vector; readonly pose: Pose }
  | {
      readonly type: "cylinder" | "capsule";
      readonly radius_m: number;
      readonly length_m: number;
      readonly pose: Pose;
    }
  | { readonly type: "sphere"; readonly radius_m: number; readonly pose: Pose }
  | { readonly type: "mesh"; readonly mesh: number; readonly pose: Pose };

export interface Body {
  readonly name: string;
  readonly kind: Kind;
  readonly color: string | null;
  readonly label: boolean;
  readonly shapes: readonly Shape[];
  readonly pose: Pose;
  readonly track: number | null;
  readonly goal: Pose | null;
}

export interface Mesh {
  readonly positions: string;
  readonly scale_m: number;
  readonly offset_m: Vector;
  readonly triangles: string;
  readonly wide: boolean;
}

export interface Tracks {
  readonly count: number;
  readonly position_scale_m: number;
  readonly position_offset_m: Vector;
  readonly positions: string;
  readonly orientations: string;
  /** Of each track the frames that its rows are of; every frame has a row where it is left out. */
  readonly keys?: string;
  readonly wide_keys?: boolean;
  readonly key_counts?: readonly number[];
  /** Track, first and last frame between which the body is not there. */
  readonly hidden: readonly (readonly [number, number, number])[];
}

export interface Skill {
  readonly name: string;
  readonly start_s: number;
  readonly end_s: number;
  readonly arm: string;
  readonly tool: string | null;
  readonly subject: string | null;
  readonly note: string | null;
}

export interface Contact {
  readonly time_s: number;
  /** How long it acts; only at `time_s` without. */
  readonly until_s?: number;
  readonly position_m: Vector;
  readonly force_n: Vector;
  readonly bodies: readonly string[];
}

export interface Path {
  readonly name: string;
  readonly points_m: readonly Vector[];
  readonly kind: "trajectory" | "tip";
}

export interface Arm {
  readonly name: string;
  readonly tip_track: number;
}

export interface Playback {
  readonly schema: string;
  readonly title: string;
  readonly duration_s: number;
  readonly frames_per_s: number;
  readonly frames: number;
  readonly bodies: readonly Body[];
  readonly meshes: readonly Mesh[];
  readonly tracks: Tracks;
  readonly skills: readonly Skill[];
  readonly contacts: readonly Contact[];
  readonly paths: readonly Path[];
  readonly arms: readonly Arm[];
  /** Where the motion is from, in a line. */
  readonly note?: string;
  readonly view: { readonly target_m: Vector; readonly eye_m: Vector } | null;
}

export const SCHEMA = "skillplan.playback/1";

/** Parses the document; throws where it is of another format. */
export function parsePlayback(text: string): Playback {
  const document = JSON.parse(text) as Playback;
  if (document.schema !== SCHEMA) {
    throw new Error(`this player reads ${SCHEMA}, and the page holds ${document.schema}`);
  }
  return document;
}
