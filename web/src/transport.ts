// The clock of the playback: where it is, whether it runs, and how fast.

export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16] as const;
// A page that was in the background goes on where it was, and does not leap.
const LONGEST_STEP_S = 0.25;

export class Transport {
  private at_s = 0;
  private running = false;
  private rate = 1;

  constructor(
    readonly duration_s: number,
    private readonly changed: () => void,
  ) {}

  get time_s(): number {
    return this.at_s;
  }

  get playing(): boolean {
    return this.running;
  }

  get speed(): number {
    return this.rate;
  }

  /** Goes on by real time; stops at the end. */
  advance(real_s: number): void {
    if (!this.running) return;
    this.at_s += Math.min(real_s, LONGEST_STEP_S) * this.rate;
    if (this.at_s >= this.duration_s) {
      this.at_s = this.duration_s;
      this.running = false;
    }
    this.changed();
  }

  seek(time_s: number): void {
    if (!Number.isFinite(time_s)) return;
    this.at_s = Math.min(Math.max(time_s, 0), this.duration_s);
    this.changed();
  }

  /** Plays; from the beginning where it is at its end. */
  play(): void {
    if (this.at_s >= this.duration_s) this.at_s = 0;
    this.running = true;
    this.changed();
  }

  pause(): void {
    this.running = false;
    this.changed();
  }

  setSpeed(speed: number): void {
    this.rate = speed;
    this.changed();
  }

  /** The next faster (1) or slower (-1) of the speeds. */
  changeSpeed(steps: number): void {
    const now = SPEEDS.findIndex((speed) => speed === this.rate);
    const next = SPEEDS[Math.min(Math.max(now + steps, 0), SPEEDS.length - 1)];
    this.setSpeed(next ?? 1);
  }
}
