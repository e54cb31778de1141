// What the plan does at a time, and in words.
import type { Contact, Skill } from "./playback";

/** A step back within this of a skill's start goes to the one before, as on a music player. */
const JUST_BEGUN_S = 0.5;
const INSTANT_S = 1e-6;

/** Indices of the skills that run at a time; at the end of the plan, of those that ended there. */
export function runningAt(skills: readonly Skill[], time_s: number): number[] {
  const end_s = Math.max(...skills.map((skill) => skill.end_s), 0);
  const found: number[] = [];
  skills.forEach((skill, index) => {
    const ends_last = time_s >= end_s && skill.end_s >= end_s - INSTANT_S;
    if (skill.start_s <= time_s + INSTANT_S && (time_s < skill.end_s || ends_last)) {
      found.push(index);
    }
  });
  return found;
}

/** The start of the next skill after a time, or the end of the plan. */
export function nextStart(skills: readonly Skill[], time_s: number, duration_s: number): number {
  const later = skills.map((skill) => skill.start_s).filter((start) => start > time_s + INSTANT_S);
  return Math.min(...later, duration_s);
}

/** The start of the skill that runs, or of the one before where it has just begun. */
export function previousStart(skills: readonly Skill[], time_s: number): number {
  const limit = time_s - JUST_BEGUN_S;
  const sooner = skills.map((skill) => skill.start_s).filter((start) => start <= limit);
  return Math.max(...sooner, 0);
}

/** Contacts that act at some time from `from_s` to `to_s`, of a list in order of time. */
export function contactsBetween(
  contacts: readonly Contact[],
  from_s: number,
  to_s: number,
): readonly Contact[] {
  const begun = contacts.slice(0, countBegun(contacts, to_s));
  return begun.filter((one) => (one.until_s ?? one.time_s) >= from_s);
}

function countBegun(contacts: readonly Contact[], time_s: number): number {
  let low = 0;
  let high = contacts.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((contacts[middle]?.time_s ?? 0) <= time_s) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** A time as minutes, seconds and tenths: 1:02.5. */
export function clockText(time_s: number): string {
  const tenths = Math.round(Math.max(0, time_s) * 10);
  const minutes = Math.floor(tenths / 600);
  const seconds = ((tenths % 600) / 10).toFixed(1);
  return `${minutes}:${seconds.padStart(4, "0")}`;
}

/** A skill in words: its place in the plan, its name, who does it with what. */
export function skillText(skills: readonly Skill[], index: number, arms: number): string {
  const skill = skills[index];
  if (!skill) return "";
  const by = [arms > 1 ? skill.arm : null, skill.tool ? `with ${skill.tool}` : null, skill.note];
  const more = by.filter((text) => text).join(", ");
  return `${index + 1} of ${skills.length}: ${skill.name}${more ? `, ${more}` : ""}`;
}
