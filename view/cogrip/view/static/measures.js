/** Measures of the drawing: pictures a second, and the time from a frame to its picture. */

const MOST = 600;

export class Measures {
  constructor() {
    this.received = 0;
    this.malformed = 0;
    this.drawn = 0;
    this.bytes = 0;
    this.recent = [];
    this.draws_ms = [];
    this.fastest_ms = Infinity;
  }

  /** @param {number} time_s of the frame @param {number} arrived_ms */
  arrived(time_s, arrived_ms) {
    this.received += 1;
    this.fastest_ms = Math.min(this.fastest_ms, arrived_ms - 1000 * time_s);
  }

  /** @param {{number: number, time_s: number} | null} frame drawn for the first time @param {number} arrived_ms @param {number} now_ms */
  drew(frame, arrived_ms, now_ms) {
    this.draws_ms.push(now_ms);
    while (this.draws_ms[0] < now_ms - 1000) this.draws_ms.shift();
    if (!frame) return;
    this.drawn += 1;
    const epoch_ms = performance.timeOrigin;
    const measured = {
      number: frame.number,
      time_s: frame.time_s,
      arrived_ms: epoch_ms + arrived_ms,
      drawn_ms: NaN,
      late_ms: now_ms - 1000 * frame.time_s - this.fastest_ms,
    };
    // By the next picture's turn the browser has taken this one.
    requestAnimationFrame(() => (measured.drawn_ms = epoch_ms + performance.now()));
    this.recent.push(measured);
    if (this.recent.length > MOST) this.recent.shift();
  }

  /** @returns {object} copy of all, for tests and benchmarks; `late_ms` is against the frame that came fastest */
  read() {
    const late = this.recent.map((each) => each.late_ms).sort((a, b) => a - b);
    const { received, malformed, drawn } = this;
    return {
      received, malformed, drawn,
      fps: this.draws_ms.length,
      late_ms: this.recent.at(-1)?.late_ms ?? NaN,
      late_p95_ms: late[Math.floor(0.95 * (late.length - 1))] ?? NaN,
      recent: structuredClone(this.recent),
    };
  }
}
