// Elements and icons, made without markup: the page allows no inline styles or scripts.

type Attributes = Readonly<Record<string, string>>;

/** Makes an element with attributes and children. */
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

// Outlines on a square of 24.
const ICONS = {
  play: "M7 4.5v15l12.5-7.5z",
  pause: "M6 4.5h4.2v15H6zM13.8 4.5H18v15h-4.2z",
  previous: "M5 5h2.6v14H5zM19.5 5v14L8.6 12z",
  next: "M16.4 5H19v14h-2.6zM4.5 5l10.9 7-10.9 7z",
} as const;
export type Icon = keyof typeof ICONS;

/** Makes an icon that readers of the screen do not mention. */
export function icon(name: Icon): SVGSVGElement {
  const namespace = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(namespace, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(namespace, "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

/** Makes a button that shows an icon or a word, with a hint that names its key. */
export function button(
  face: SVGSVGElement | string,
  label: string,
  key: string,
  act: () => void,
): HTMLButtonElement {
  const hint = `${label} (${key})`;
  const made = make("button", { type: "button", title: hint, "aria-keyshortcuts": key }, face);
  if (typeof face !== "string") made.setAttribute("aria-label", label);
  made.addEventListener("click", act);
  return made;
}
