// Dark or light: as the page says, else as the system does. Colours are variables of the style sheet.
import { KINDS, type Kind } from "./playback";

export type Theme = "dark" | "light";
type Role = "sky" | "ground" | "back" | "grid" | "grid-metre" | "edge" | "ghost" | "force";
export type PathRole = "path-trajectory" | "path-tip";
export type Palette = Readonly<Record<Kind | Role | PathRole, string>>;

const ROLES: readonly (Role | PathRole)[] = [
  "sky",
  "ground",
  "back",
  "grid",
  "grid-metre",
  "edge",
  "ghost",
  "force",
  "path-trajectory",
  "path-tip",
];
const DARK = "(prefers-color-scheme: dark)";

/** The theme that holds now. */
export function currentTheme(): Theme {
  const chosen = document.documentElement.dataset["theme"];
  if (chosen === "dark" || chosen === "light") return chosen;
  return matchMedia(DARK).matches ? "dark" : "light";
}

/** Changes the whole page's theme: `data-theme` of the root element, which its styles heed. */
export function toggleTheme(): void {
  document.documentElement.dataset["theme"] = currentTheme() === "dark" ? "light" : "dark";
}

/** Calls back after each change of the theme, by whomever. */
export function onThemeChange(react: () => void): void {
  matchMedia(DARK).addEventListener("change", react);
  const observer = new MutationObserver(react);
  observer.observe(document.documentElement, { attributeFilter: ["data-theme"] });
}

/** Reads the colours that the style sheet gives an element: `--player-part` and so on. */
export function paletteOf(element: Element): Palette {
  const style = getComputedStyle(element);
  const names = [...KINDS, ...ROLES];
  const entries = names.map((name) => [name, style.getPropertyValue(`--player-${name}`).trim()]);
  return Object.fromEntries(entries) as Palette;
}
