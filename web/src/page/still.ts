// Paper shows a still of the picture, on white.

/** Puts a copy of the picture in its place while the page prints; `redraw` draws it in a theme. */
export function printStills(canvas: HTMLCanvasElement, redraw: () => void): void {
  const still = document.createElement("canvas");
  still.className = "player-still";
  let theme: string | undefined;
  addEventListener("beforeprint", () => {
    theme = document.documentElement.dataset["theme"];
    document.documentElement.dataset["theme"] = "light";
    redraw();
    still.width = canvas.width;
    still.height = canvas.height;
    still.getContext("2d")?.drawImage(canvas, 0, 0);
    canvas.after(still);
  });
  addEventListener("afterprint", () => {
    still.remove();
    if (theme === undefined) delete document.documentElement.dataset["theme"];
    else document.documentElement.dataset["theme"] = theme;
    redraw();
  });
}
