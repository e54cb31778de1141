// Keys, while the focus is in the player; the arrows belong to the picture where that has the focus.

/** What keys do, by `KeyboardEvent.key` in lower case. */
export type KeyActions = Readonly<Record<string, (event: KeyboardEvent) => void>>;

/** Lets keys act; a control that has the focus keeps the keys that it uses itself. */
export function listenToKeys(
  player: HTMLElement,
  canvas: HTMLElement,
  anywhere: KeyActions,
  inPicture: KeyActions,
): void {
  player.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const target = event.target instanceof Element ? event.target : player;
    if (target.closest("dialog")) return;
    const key = event.key.toLowerCase();
    const isSpace = key === " ";
    if (isSpace && target.closest("button, select")) return;
    if (target.closest("select") && (key.length > 1 || /[a-z0-9]/.test(key))) return;
    const act = (target === canvas ? inPicture[key] : undefined) ?? anywhere[key];
    if (!act) return;
    event.preventDefault();
    act(event);
  });
}
