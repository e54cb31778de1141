// Names beside bodies: elements over the picture, of which none covers another.
import type { PerspectiveCamera, Vector3 } from "three";

const GAP_PX = 6;

interface Label {
  readonly element: HTMLElement;
  width: number;
  height: number;
}

export class Labels {
  private readonly labels = new Map<string, Label>();

  constructor(private readonly layer: HTMLElement) {}

  hide(): void {
    this.layer.hidden = true;
  }

  /** Shows names where they belong; those of `first` win where two would cover each other. */
  update(
    places: ReadonlyMap<string, Vector3>,
    camera: PerspectiveCamera,
    first: ReadonlySet<string>,
  ): void {
    this.layer.hidden = false;
    const { clientWidth: width, clientHeight: height } = this.layer;
    const taken: (readonly [number, number, number, number])[] = [];
    const names = [...places.keys()].sort((a, b) => Number(first.has(b)) - Number(first.has(a)));
    const shown = new Set<string>();
    for (const name of names) {
      const point = places.get(name)?.clone().project(camera);
      if (!point || Math.abs(point.x) > 1 || Math.abs(point.y) > 1 || point.z > 1) continue;
      const label = this.label(name);
      const left = ((point.x + 1) / 2) * width - label.width / 2;
      const top = ((1 - point.y) / 2) * height - label.height - GAP_PX;
      const [right, bottom] = [left + label.width, top + label.height];
      if (taken.some(([l, t, r, b]) => left < r && right > l && top < b && bottom > t)) continue;
      taken.push([left, top, right, bottom]);
      shown.add(name);
      label.element.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
      label.element.classList.toggle("player-label-current", first.has(name));
    }
    for (const [name, { element }] of this.labels) element.hidden = !shown.has(name);
  }

  private label(name: string): Label {
    const known = this.labels.get(name);
    if (known) return known;
    const element = document.createElement("span");
    element.className = "player-label";
    element.textContent = name;
    this.layer.append(element);
    const made = { element, width: element.offsetWidth, height: element.offsetHeight };
    this.labels.set(name, made);
    return made;
  }
}
