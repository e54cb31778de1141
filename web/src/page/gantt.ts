// What the page shows elsewhere follows the playback, and leads it: elements with `data-seek-s` seek,
// `gantt-cursor` moves, and elements with `data-skill` are marked while their skill runs.

/** Seeks where an element that names a time is clicked, or Enter is pressed on it. */
export function listenToPage(seek: (time_s: number) => void): void {
  const react = (event: Event): void => {
    const target = event.target instanceof Element ? event.target : null;
    const named = target?.closest("[data-seek-s]");
    if (named) seek(Number(named.getAttribute("data-seek-s")));
  };
  document.addEventListener("click", react);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Enter") react(event);
  });
  document.addEventListener("skillplan:seek", (event) => {
    if (event instanceof CustomEvent) seek(Number(event.detail));
  });
}

/** Moves the cursor of the Gantt chart and tells the page the time. */
export function showTime(time_s: number, duration_s: number): void {
  const cursor = document.getElementById("gantt-cursor");
  if (cursor) {
    const [from, to] = [Number(cursor.dataset["x0"]), Number(cursor.dataset["x1"])];
    const share = duration_s > 0 ? time_s / duration_s : 0;
    cursor.setAttribute("transform", `translate(${(from + (to - from) * share).toFixed(2)} 0)`);
  }
  document.dispatchEvent(new CustomEvent("skillplan:time", { detail: time_s }));
}

/** Marks what belongs to the skills that run. */
export function markSkills(running: readonly number[]): void {
  for (const element of document.querySelectorAll("[data-skill]")) {
    const runs = running.includes(Number(element.getAttribute("data-skill")));
    if (runs) element.setAttribute("aria-current", "step");
    else element.removeAttribute("aria-current");
  }
}
