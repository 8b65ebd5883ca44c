/**
 * Binary messages of the view's socket, as docs/view.md has them: frames, own hand, chunks, pointer messages.
 * Numbers stay the float64 that were sent.
 */

export const FRAME = 1;
export const POINTER = 2;
export const OWN_HAND = 3;
export const CHUNK = 4;

export const STATES = ["free", "joining", "live", "degraded", "fault", "silent"];
const PUSHES = 1;
const NOT_PASSIVE = 2;
const HAND_KNOWN = 4;
const CONTACT = 1;

const HEAD_BYTES = 96;
const PERSON_BYTES = 160;
const BODY_BYTES = 56;
const OWN_HAND_BYTES = 64;
const CHUNK_HEAD_BYTES = 12;

/** @typedef {[number, number, number]} Vector metres or newtons along x, y, z */
/**
 * @typedef {object} Person one person at one moment; NaN: not known
 * @property {number} seat
 * @property {string} state one of STATES
 * @property {boolean} pushes
 * @property {boolean} passive
 * @property {boolean} hand_known
 * @property {number} lost
 * @property {Vector} hand_m
 * @property {Vector} proxy_m
 * @property {Vector} force_n on the object
 * @property {Vector} seen_m the object as this person is shown it
 * @property {number} rtt_ms
 * @property {number} up_ms
 * @property {number} down_ms
 * @property {number} buffer_up_ms
 * @property {number} buffer_down_ms
 * @property {number} up_reserve_mj
 * @property {number} line_reserve_mj
 * @property {number} loss share of the last second, 0 to 1
 * @property {number} buttons that are down: bit k, button k + 1
 * @property {number} grip_m opening of the gripper
 * @property {[number, number, number, number]} orientation of the handle: w, x, y, z
 */
/**
 * @typedef {object} Frame
 * @property {number} axes
 * @property {boolean} contact
 * @property {number} number
 * @property {number} time_s
 * @property {Vector} position_m
 * @property {Vector} velocity_mps
 * @property {[number, number, number, number]} orientation w, x, y, z
 * @property {Person[]} people
 * @property {Pose[]} bodies of a scene, by their numbers
 */
/** @typedef {{position_m: Vector, orientation: [number, number, number, number]}} Pose orientation: w, x, y, z; NaN: not known */
/** @typedef {{state: string, taken: number, position_m: Vector, force_n: Vector, limit_n: number}} OwnHand */

/** @param {DataView} view @param {number} offset @returns {Vector} */
function vectorAt(view, offset) {
  return [view.getFloat64(offset, true), view.getFloat64(offset + 8, true), view.getFloat64(offset + 16, true)];
}

/** @param {DataView} view @param {number} offset @returns {[number, number, number, number]} */
function quaternionAt(view, offset) {
  return [...vectorAt(view, offset), view.getFloat64(offset + 24, true)];
}

/** @param {number} number @returns {string} */
function stateName(number) {
  if (number >= STATES.length) throw new RangeError(`state ${number} is not one of the ${STATES.length} there are`);
  return STATES[number];
}

/** @param {DataView} view @returns {Frame} the frame that fills the view; RangeError: it is none */
export function decodeFrame(view) {
  const count = view.byteLength >= HEAD_BYTES ? view.getUint8(2) : 0;
  const end = HEAD_BYTES + count * PERSON_BYTES;
  if (view.byteLength < end || (view.byteLength - end) % BODY_BYTES !== 0 || view.getUint8(0) !== FRAME) {
    throw new RangeError(`${view.byteLength} bytes that are no frame of ${count} people`);
  }
  const people = [];
  for (let index = 0; index < count; index += 1) people.push(decodePerson(view, HEAD_BYTES + index * PERSON_BYTES));
  const bodies = [];
  for (let at = end; at < view.byteLength; at += BODY_BYTES) bodies.push({ position_m: vectorAt(view, at), orientation: quaternionAt(view, at + 24) });
  return {
    axes: view.getUint8(1),
    contact: (view.getUint8(3) & CONTACT) !== 0,
    number: view.getUint32(4, true),
    time_s: view.getFloat64(8, true),
    position_m: vectorAt(view, 16),
    velocity_mps: vectorAt(view, 40),
    orientation: quaternionAt(view, 64),
    people,
    bodies,
  };
}

/** @param {DataView} view @param {number} at @returns {Person} */
function decodePerson(view, at) {
  const flags = view.getUint8(at + 2);
  return {
    seat: view.getUint8(at),
    state: stateName(view.getUint8(at + 1)),
    pushes: (flags & PUSHES) !== 0,
    passive: (flags & NOT_PASSIVE) === 0,
    hand_known: (flags & HAND_KNOWN) !== 0,
    lost: view.getUint32(at + 4, true),
    hand_m: vectorAt(view, at + 8),
    proxy_m: vectorAt(view, at + 32),
    force_n: vectorAt(view, at + 56),
    seen_m: vectorAt(view, at + 80),
    rtt_ms: view.getFloat32(at + 104, true),
    up_ms: view.getFloat32(at + 108, true),
    down_ms: view.getFloat32(at + 112, true),
    buffer_up_ms: view.getFloat32(at + 116, true),
    buffer_down_ms: view.getFloat32(at + 120, true),
    up_reserve_mj: view.getFloat32(at + 124, true),
    line_reserve_mj: view.getFloat32(at + 128, true),
    loss: view.getFloat32(at + 132, true),
    buttons: view.getUint32(at + 136, true),
    grip_m: view.getFloat32(at + 140, true),
    orientation: [144, 148, 152, 156].map((offset) => view.getFloat32(at + offset, true)),
  };
}

/** @param {DataView} view @returns {OwnHand} */
export function decodeOwnHand(view) {
  if (view.byteLength !== OWN_HAND_BYTES) throw new RangeError(`${view.byteLength} bytes that are no own hand`);
  return {
    state: stateName(view.getUint8(1)),
    taken: view.getUint32(4, true),
    position_m: vectorAt(view, 8),
    force_n: vectorAt(view, 32),
    limit_n: view.getFloat64(56, true),
  };
}

/**
 * @param {number} number of this message, from 1
 * @param {boolean} holds
 * @param {Vector} target
 * @param {number} [buttons] that are down: bit k, button k + 1
 * @returns {ArrayBuffer}
 */
export function encodePointer(number, holds, target, buttons = 0) {
  const view = new DataView(new ArrayBuffer(32));
  view.setUint8(0, POINTER);
  view.setUint8(1, holds ? 1 : 0);
  view.setUint16(2, buttons, true);
  view.setUint32(4, number, true);
  target.forEach((value, axis) => view.setFloat64(8 + 8 * axis, value, true));
  return view.buffer;
}

/** Frames of a chunk of a recording, decoded one at a time. */
export class Chunk {
  /** @param {number} number @param {ArrayBuffer} data frames one behind the other @param {number} count */
  constructor(number, data, count) {
    this.number = number;
    this.count = count;
    this.data = data;
    this.size = count > 0 ? data.byteLength / count : 0;
    if (!Number.isInteger(this.size)) throw new RangeError(`chunk ${number}: ${data.byteLength} bytes, not ${count} frames`);
    this.whole = new DataView(data);
  }

  /** @param {number} index @returns {Frame} */
  frame(index) {
    return decodeFrame(new DataView(this.data, index * this.size, this.size));
  }

  /** @param {number} index @returns {number} time of a frame [s] */
  time(index) {
    return this.whole.getFloat64(index * this.size + 8, true);
  }

  /** @param {number} time_s @returns {number} index of the last frame that is not later, or -1 */
  indexAt(time_s) {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) <= time_s) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }
}

/** @param {Uint8Array} message @returns {Promise<Chunk>} */
export async function unpackChunk(message) {
  const view = new DataView(message.buffer, message.byteOffset, message.byteLength);
  if (message.byteLength < CHUNK_HEAD_BYTES || view.getUint8(0) !== CHUNK) throw new RangeError("this is no chunk");
  const packed = new Blob([message.subarray(CHUNK_HEAD_BYTES)]).stream();
  const data = await new Response(packed.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  return new Chunk(view.getUint32(4, true), data, view.getUint32(8, true));
}
