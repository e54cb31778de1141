// Where bodies are at a time: frames with straight lines and slerp between them.
import { int16Of } from "./decode";
import type { Playback, Pose } from "./playback";

const ORIENTATION_STEPS = 32767;
// Closer than this, a sine of the angle says nothing; the chord is then as good as the arc.
const NEARLY_EQUAL = 0.9995;

type Quaternion = readonly [number, number, number, number];

/** Spherical interpolation from `a` (share 0) to `b` (share 1), the short way round. */
export function slerp(a: Quaternion, b: Quaternion, share: number): Quaternion {
  let cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  const sign = cosine < 0 ? -1 : 1;
  cosine *= sign;
  let from = 1 - share;
  let to = share;
  if (cosine < NEARLY_EQUAL) {
    const angle = Math.acos(cosine);
    from = Math.sin(from * angle) / Math.sin(angle);
    to = Math.sin(to * angle) / Math.sin(angle);
  }
  to *= sign;
  return unit(
    a[0] * from + b[0] * to,
    a[1] * from + b[1] * to,
    a[2] * from + b[2] * to,
    a[3] * from + b[3] * to,
  );
}

function unit(x: number, y: number, z: number, w: number): Quaternion {
  const length = Math.hypot(x, y, z, w);
  return length > 0 ? [x / length, y / length, z / length, w / length] : [0, 0, 0, 1];
}

/** The frame at or before a time, and how far on the way to the next one it is (0 to 1). */
export function frameAt(
  time_s: number,
  frames: number,
  frames_per_s: number,
  duration_s: number,
): readonly [number, number] {
  const last = frames - 1;
  if (last <= 0 || time_s <= 0) return [0, 0];
  if (time_s >= duration_s) return [last, 0];
  const frame = Math.min(Math.floor(time_s * frames_per_s), last - 1);
  const start_s = frame / frames_per_s;
  // The last frame stands at the end, which may be sooner than a whole frame later.
  const end_s = frame + 1 === last ? duration_s : (frame + 1) / frames_per_s;
  if (end_s <= start_s) return [frame, 0];
  return [frame, Math.min(1, Math.max(0, (time_s - start_s) / (end_s - start_s)))];
}

/** The tracks of a playback, asked by time. */
export class Motion {
  private readonly positions: Int16Array;
  private readonly orientations: Int16Array;
  private readonly hidden = new Map<number, (readonly [number, number])[]>();

  constructor(private readonly playback: Playback) {
    this.positions = int16Of(playback.tracks.positions);
    this.orientations = int16Of(playback.tracks.orientations);
    for (const [track, first, last] of playback.tracks.hidden) {
      const spans = this.hidden.get(track) ?? [];
      spans.push([first, last]);
      this.hidden.set(track, spans);
    }
  }

  /** The pose of a track at a time, or null while its body is not there. */
  pose(track: number, time_s: number): Pose | null {
    const { frames, frames_per_s, duration_s } = this.playback;
    const [frame, share] = frameAt(time_s, frames, frames_per_s, duration_s);
    if (this.isHidden(track, frame)) return null;
    // What vanishes at the next frame stays where it was until then.
    const next = share > 0 && !this.isHidden(track, frame + 1) ? frame + 1 : frame;
    const q = slerp(this.quaternion(track, frame), this.quaternion(track, next), share);
    const [x, y, z] = [0, 1, 2].map((axis) => {
      const from = this.coordinate(track, frame, axis);
      return from + (this.coordinate(track, next, axis) - from) * share;
    }) as [number, number, number];
    return [x, y, z, ...q];
  }

  private isHidden(track: number, frame: number): boolean {
    const spans = this.hidden.get(track);
    return spans?.some(([first, last]) => first <= frame && frame <= last) ?? false;
  }

  private coordinate(track: number, frame: number, axis: number): number {
    const { count, position_scale_m, position_offset_m } = this.playback.tracks;
    const steps = this.positions[(frame * count + track) * 3 + axis] ?? 0;
    return (position_offset_m[axis] ?? 0) + position_scale_m * steps;
  }

  private quaternion(track: number, frame: number): Quaternion {
    const at = (frame * this.playback.tracks.count + track) * 4;
    const value = (index: number) => (this.orientations[at + index] ?? 0) / ORIENTATION_STEPS;
    return unit(value(0), value(1), value(2), value(3));
  }
}
