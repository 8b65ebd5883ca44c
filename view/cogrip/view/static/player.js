/** A recording that is played: chunks as they come, the time that is shown, and the frame at that time. */

import { unpackChunk } from "./frames.js";

export const CHUNK_S = 10;
export const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 5, 10];
const MOST_CHUNKS = 12; // kept, of those nearest
const LONGEST_STEP_S = 0.25; // of the clock between two pictures: a tab that was hidden does not leap

export class Player {
  /**
   * @param {object} scene message, mode "recording"
   * @param {(number: number) => void} ask for a chunk; its answer goes to `take`
   * @param {() => void} changed
   */
  constructor(scene, ask, changed) {
    this.scene = scene;
    this.ask = ask;
    this.changed = changed;
    this.duration_s = scene.duration_s ?? 0;
    this.chunks = new Map();
    this.asked = new Set();
    this.time_s = 0;
    this.speed = 1;
    this.playing = false;
    this.loop = { on: false, from_s: 0, to_s: this.duration_s };
    this.arrivals = 0;
    this.want(0);
    this.want(1);
  }

  /** @param {number} number of a chunk that will be shown soon */
  want(number) {
    if (number < 0 || number >= this.scene.chunks || this.chunks.has(number) || this.asked.has(number)) return;
    this.asked.add(number);
    this.ask(number);
  }

  /** Ask again for what did not come before a break. */
  askAgain() {
    this.asked.clear();
    this.locate(this.time_s);
  }

  /** @param {Uint8Array} message */
  async take(message) {
    const chunk = await unpackChunk(message);
    this.asked.delete(chunk.number);
    this.chunks.set(chunk.number, chunk);
    const here = this.chunkAt(this.time_s);
    const farthest = [...this.chunks.keys()].sort((a, b) => Math.abs(b - here) - Math.abs(a - here));
    for (const number of farthest.slice(0, Math.max(0, this.chunks.size - MOST_CHUNKS))) this.chunks.delete(number);
    this.arrivals += 1;
    this.changed();
  }

  /** @param {number} time_s @returns {number} */
  chunkAt(time_s) {
    return Math.min(Math.max(0, Math.floor(time_s / CHUNK_S)), Math.max(0, this.scene.chunks - 1));
  }

  /** Find the last frame that is not later. @param {number} time_s @returns {{number: number, index: number} | null} null: not here yet */
  locate(time_s) {
    const here = this.chunkAt(time_s);
    this.want(here);
    this.want(here + 1);
    if (this.speed >= 5) this.want(here + 2);
    if (this.loop.on) this.want(this.chunkAt(this.loop.from_s));
    for (let number = here; number >= 0; number -= 1) {
      const chunk = this.chunks.get(number);
      if (!chunk) {
        this.want(number);
        return null;
      }
      const index = chunk.indexAt(time_s);
      if (index >= 0) return { number, index };
    }
    return this.chunks.get(here).count > 0 ? { number: here, index: 0 } : null;
  }

  /** @returns {import("./frames.js").Frame | null} what is to be shown now */
  frame() {
    const at = this.locate(this.time_s);
    return at && this.chunks.get(at.number).frame(at.index);
  }

  /** @param {number} from_s @param {number} to_s @returns {import("./frames.js").Frame[]} those after `from_s` that are here, up to `to_s` */
  between(from_s, to_s) {
    const frames = [];
    for (let number = this.chunkAt(from_s); number <= this.chunkAt(to_s); number += 1) {
      const chunk = this.chunks.get(number);
      if (!chunk) continue;
      for (let index = chunk.indexAt(from_s) + 1; index < chunk.count && chunk.time(index) <= to_s; index += 1) {
        frames.push(chunk.frame(index));
      }
    }
    return frames;
  }

  /** Let time pass. @param {number} seconds of the wall clock */
  advance(seconds) {
    if (!this.playing || !this.locate(this.time_s)) return;
    const next_s = this.time_s + Math.min(seconds, LONGEST_STEP_S) * this.speed;
    const end_s = this.loop.on ? this.loop.to_s : this.duration_s;
    if (next_s < end_s) this.time_s = next_s;
    else if (this.loop.on) this.time_s = this.loop.from_s;
    else {
      this.time_s = this.duration_s;
      this.playing = false;
    }
  }

  toggle() {
    if (!this.playing && this.time_s >= this.duration_s) this.time_s = 0;
    this.playing = !this.playing;
    this.changed();
  }

  /** @param {number} time_s */
  seek(time_s) {
    this.time_s = Math.min(Math.max(0, time_s), this.duration_s);
    this.changed();
  }

  /** Show the next frame or the one before, and pause. @param {1 | -1} direction */
  step(direction) {
    this.playing = false;
    const at = this.locate(this.time_s);
    if (!at) return;
    let { number, index } = { ...at, index: at.index + direction };
    while (this.chunks.has(number) && (index < 0 || index >= this.chunks.get(number).count)) {
      number += direction;
      index = direction > 0 ? 0 : (this.chunks.get(number)?.count ?? 0) - 1;
    }
    if (this.chunks.has(number)) this.time_s = this.chunks.get(number).time(index);
    else this.want(number);
    this.changed();
  }

  /** Go to the next event or the one before. @param {1 | -1} direction */
  toEvent(direction) {
    const times = this.scene.events.map((event) => event.time_s).sort((a, b) => a - b);
    const time_s = direction > 0 ? times.find((each) => each > this.time_s + 1e-9) : times.findLast((each) => each < this.time_s - 0.05);
    this.seek(time_s ?? (direction > 0 ? this.duration_s : 0));
  }

  /** @param {1 | -1} direction */
  changeSpeed(direction) {
    const index = SPEEDS.findIndex((each) => each >= this.speed) + direction;
    this.speed = SPEEDS[Math.min(Math.max(0, index), SPEEDS.length - 1)];
    this.changed();
  }

  /** @param {"from_s" | "to_s"} end is to be at the time shown now */
  markLoop(end) {
    this.loop[end] = this.time_s;
    if (this.loop.from_s >= this.loop.to_s) {
      this.loop = end === "from_s" ? { ...this.loop, to_s: this.duration_s } : { ...this.loop, from_s: 0 };
    }
    this.loop.on = true;
    this.changed();
  }

  toggleLoop() {
    this.loop.on = !this.loop.on;
    this.changed();
  }
}
