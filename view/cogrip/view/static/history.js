/** The last seconds of a session in columns, as the plots want them. */

const LEAST_STEP_S = 0.025; // more points than 40 a second show nothing more

/** @param {number} value @returns {number | null} null where it is not known */
const known = (value) => (Number.isFinite(value) ? value : null);

/**
 * What is plotted. `lines`: for each person, [key, dashed, value].
 * `object`: a value of the object beside the people's.
 */
export const QUANTITIES = [
  {
    id: "position", title: "Position", unit: "mm", note: "object ╌╌", along: true,
    object: (frame, axis) => 1000 * frame.position_m[axis],
    lines: [["hand", false, (person, axis) => (person.hand_known ? 1000 * person.hand_m[axis] : NaN)]],
  },
  {
    id: "force", title: "Force on the object", unit: "N", note: "", along: true,
    lines: [["force", false, (person, axis) => person.force_n[axis]]],
  },
  {
    id: "margin", title: "Energy reserve", unit: "mJ", note: "line ╌╌",
    lines: [["up", false, (person) => person.up_reserve_mj], ["line", true, (person) => person.line_reserve_mj]],
  },
  { id: "rtt", title: "Round trip", unit: "ms", note: "", lines: [["rtt", false, (person) => person.rtt_ms]] },
  {
    id: "buffer", title: "Jitter buffer", unit: "ms", note: "down ╌╌",
    lines: [["up", false, (person) => person.buffer_up_ms], ["down", true, (person) => person.buffer_down_ms]],
  },
  { id: "loss", title: "Frames lost", unit: "%", note: "in the last second", lines: [["loss", false, (person) => 100 * person.loss]] },
];

export class History {
  /** @param {number} window_s */
  constructor(window_s) {
    this.window_s = window_s;
    this.seats = [];
    this.clear();
  }

  clear() {
    /** @type {import("./frames.js").Frame[]} */
    this.frames = [];
  }

  get end_s() {
    return this.frames.at(-1)?.time_s ?? 0;
  }

  /** Take a frame; one older than the newest begins anew. @param {import("./frames.js").Frame} frame */
  push(frame) {
    if (frame.time_s < this.end_s) this.frames = [];
    if (this.frames.length > 0 && frame.time_s - this.end_s < LEAST_STEP_S) return;
    this.frames.push(frame);
    const oldest = frame.time_s - this.window_s;
    if (this.frames[0].time_s < oldest - 1) this.frames = this.frames.filter((each) => each.time_s >= oldest - 0.1);
  }

  /**
   * @param {object} quantity one of QUANTITIES
   * @param {number} axis
   * @returns {(number | null)[][]} times, the object's if there is one, then the lines of each person
   */
  columns(quantity, axis) {
    const columns = [this.frames.map((frame) => frame.time_s)];
    if (quantity.object) columns.push(this.frames.map((frame) => known(quantity.object(frame, axis))));
    const people = this.frames.map((frame) => new Map(frame.people.map((person) => [person.seat, person])));
    for (const seat of this.seats) {
      for (const [, , value] of quantity.lines) {
        columns.push(
          people.map((bySeat) => {
            const person = bySeat.get(seat);
            return person && person.state !== "free" ? known(value(person, axis)) : null;
          }),
        );
      }
    }
    return columns;
  }
}
