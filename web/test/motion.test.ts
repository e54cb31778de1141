// Where bodies are between the frames that a page keeps.
import { strict as assert } from "node:assert";
import { test } from "node:test";
import { frameAt, Motion, slerp } from "../src/motion";
import type { Playback, Tracks } from "../src/playback";

const HALF = Math.SQRT1_2;

function base64(values: Int16Array | Uint16Array): string {
  return btoa(String.fromCharCode(...new Uint8Array(values.buffer)));
}

/** One track along x, a metre a frame, turning about z by a quarter turn a frame. */
function playback(more: Partial<Tracks> = {}, frames = 3): Playback {
  const rows = [0, 1, 2].map((frame) => [frame * 1000, 0, 500]).flat();
  const turns = [0, 1, 2].map((frame) => {
    const half_rad = (frame * Math.PI) / 4;
    return [0, 0, Math.sin(half_rad), Math.cos(half_rad)].map((one) => Math.round(one * 32767));
  });
  const tracks: Tracks = {
    count: 1,
    position_scale_m: 0.001,
    position_offset_m: [0, 0.25, 0],
    positions: base64(Int16Array.from(rows)),
    orientations: base64(Int16Array.from(turns.flat())),
    hidden: [],
    ...more,
  };
  return {
    schema: "skillplan.playback/1",
    title: "a track",
    duration_s: (frames - 1) / 10,
    frames_per_s: 10,
    frames,
    bodies: [],
    meshes: [],
    tracks,
    skills: [],
    contacts: [],
    paths: [],
    arms: [],
    view: null,
  };
}

function near(found: readonly number[] | null, expected: readonly number[]): void {
  assert.ok(found);
  found.forEach((value, index) => assert.ok(Math.abs(value - (expected[index] ?? NaN)) < 1e-4));
}

test("half-way between two quarter turns is an eighth turn", () => {
  near(slerp([0, 0, 0, 1], [0, 0, HALF, HALF], 0.5), [
    0,
    0,
    Math.sin(Math.PI / 8),
    Math.cos(Math.PI / 8),
  ]);
});

test("the short way round is taken, whatever the signs of quaternions", () => {
  near(slerp([0, 0, 0, 1], [0, 0, -HALF, -HALF], 0.5), [
    0,
    0,
    Math.sin(Math.PI / 8),
    Math.cos(Math.PI / 8),
  ]);
});

test("frames begin at 0 and end at the end, which may be sooner than a whole frame later", () => {
  assert.deepEqual(frameAt(-1, 5, 10, 0.35), [0, 0]);
  assert.deepEqual(frameAt(9, 5, 10, 0.35), [4, 0]);
  const [frame, share] = frameAt(0.325, 5, 10, 0.35);
  assert.equal(frame, 3);
  assert.ok(Math.abs(share - 0.5) < 1e-9);
});

test("a pose between frames is on the line between them", () => {
  near(new Motion(playback()).pose(0, 0.15), [
    1.5,
    0.25,
    0.5,
    0,
    0,
    Math.sin((3 * Math.PI) / 8),
    Math.cos((3 * Math.PI) / 8),
  ]);
});

test("of a track that keeps some frames, those between are on the line, and the last one holds", () => {
  const keys = base64(Uint16Array.from([0, 4, 8]));
  const motion = new Motion(playback({ keys, key_counts: [3] }, 12));
  assert.equal(motion.pose(0, 0.2)?.[0].toFixed(4), "0.5000");
  assert.equal(motion.pose(0, 1.1)?.[0].toFixed(4), "2.0000");
});

test("while a body is not there it has no pose, and stays where it was until then", () => {
  const motion = new Motion(playback({ hidden: [[0, 1, 1]] }));
  assert.equal(motion.pose(0, 0.1), null);
  assert.equal(motion.pose(0, 0.09)?.[0], 0);
  assert.equal(motion.pose(0, 0.2)?.[0].toFixed(4), "2.0000");
});
