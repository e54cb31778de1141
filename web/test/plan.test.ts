// What the plan does at a time, and in words.
import { strict as assert } from "node:assert";
import { test } from "node:test";
import {
  clockText,
  contactsBetween,
  nextStart,
  previousStart,
  runningAt,
  skillText,
} from "../src/plan";
import type { Contact, Skill } from "../src/playback";

function skill(name: string, start_s: number, end_s: number, arm = "panda"): Skill {
  return { name, start_s, end_s, arm, tool: "gripper", subject: null, note: null };
}

const SKILLS = [skill("pick", 0, 4), skill("place", 4, 9), skill("walk", 6, 9, "legs")];

test("skills run from their start until before their end; at the end of the plan the last do", () => {
  assert.deepEqual(runningAt(SKILLS, 0), [0]);
  assert.deepEqual(runningAt(SKILLS, 4), [1]);
  assert.deepEqual(runningAt(SKILLS, 7), [1, 2]);
  assert.deepEqual(runningAt(SKILLS, 9), [1, 2]);
  assert.deepEqual(runningAt([], 1), []);
});

test("a step goes to the next start, or to the end", () => {
  assert.equal(nextStart(SKILLS, 0, 9), 4);
  assert.equal(nextStart(SKILLS, 4, 9), 6);
  assert.equal(nextStart(SKILLS, 7, 9), 9);
});

test("a step back goes to the start of what runs, or to the one before if it has just begun", () => {
  assert.equal(previousStart(SKILLS, 5.5), 4);
  assert.equal(previousStart(SKILLS, 4.2), 0);
  assert.equal(previousStart(SKILLS, 0.2), 0);
});

test("contacts act from their time until they end", () => {
  const contact = (time_s: number, until_s?: number): Contact => ({
    time_s,
    ...(until_s === undefined ? {} : { until_s }),
    position_m: [0, 0, 0],
    force_n: [0, 0, 1],
    bodies: ["a", "b"],
  });
  const contacts = [contact(1), contact(2, 5), contact(4)];
  assert.deepEqual(contactsBetween(contacts, 3, 3.5), [contacts[1]]);
  assert.deepEqual(contactsBetween(contacts, 0.9, 1.1), [contacts[0]]);
  assert.deepEqual(contactsBetween(contacts, 4, 4), [contacts[1], contacts[2]]);
});

test("times and skills are said in words", () => {
  assert.equal(clockText(62.46), "1:02.5");
  assert.equal(clockText(-3), "0:00.0");
  assert.equal(skillText(SKILLS, 1, 1), "2 of 3: place, with gripper");
  assert.equal(skillText(SKILLS, 2, 2), "3 of 3: walk, legs, with gripper");
  assert.equal(skillText(SKILLS, 7, 1), "");
});
