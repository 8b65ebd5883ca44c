/**
 * The hand of this page: pointer, finger or gamepad pulls a virtual device, which the server's process simulates. The picture shows the
 * device where the process says it is, never at the pointer: how far it stays behind is what the user sees of the force.
 */

import { Plane, Raycaster, Vector2, Vector3 } from "three";
import { encodePointer } from "./frames.js";
import { isAnswering } from "./panel.js";

const REPEAT_MS = 30; // the process lets go after 100 ms of silence
const GRASP_PIXELS = { mouse: 26, pen: 30, touch: 44 };
const DEPTH_PER_WHEEL_PIXEL = 0.0002; // metres
const GAMEPAD_PERIOD_MS = 10;
const GAMEPAD_MPS = 0.15; // at full deflection
const GAMEPAD_DEAD = 0.12;
const RUMBLE_MS = 80;
const FARTHEST_M = 9.9; // the process takes none from 10 m on
const PULLS = [0, 4, 5]; // buttons of a gamepad that hold the device
const MOST_BUTTONS = 16;

/** @param {string} key as KeyboardEvent.key has it @returns {number} bit of its button; the keys 1 to 4 turn the picture */
const keyBit = (key) => (/^[5-9]$/.test(key) ? 1 << (Number(key) - 1) : 0);

/** @param {Gamepad | undefined} pad @returns {number} its buttons that are down, but for those that hold the device */
function padBits(pad) {
  return (pad?.buttons ?? []).slice(0, MOST_BUTTONS).reduce((bits, each, index) => (each.pressed && !PULLS.includes(index) ? bits | (1 << index) : bits), 0);
}

export class Hand {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./picture.js").Picture} picture
   * @param {(message: ArrayBuffer) => boolean} send
   * @param {() => void} changed
   */
  constructor(canvas, picture, send, changed) {
    this.canvas = canvas;
    this.picture = picture;
    this.send = send;
    this.changed = changed;
    this.scene = null;
    this.own = null;
    this.number = 0;
    this.sent_ms = -Infinity;
    this.target = null; // [m], relative to the point held; null: lets go
    this.pointers = new Map();
    this.keys = 0; // buttons that are down, one bit each
    this.padButtons = 0;
    this.rumbled_ms = 0;
    const listen = (name, handler) => canvas.addEventListener(name, handler, { capture: true, passive: false });
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.move(event));
    listen("wheel", (event) => this.wheel(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) listen(name, (event) => this.release(event));
    for (const name of ["blur", "pagehide"]) window.addEventListener(name, () => this.leave());
    document.addEventListener("visibilitychange", () => document.hidden && this.leave());
    document.addEventListener("keydown", (event) => !event.ctrlKey && !event.metaKey && !isAnswering(event) && this.hold("keys", this.keys | keyBit(event.key)));
    document.addEventListener("keyup", (event) => this.hold("keys", this.keys & ~keyBit(event.key)));
    setInterval(() => this.repeat(), REPEAT_MS);
    setInterval(() => this.pollGamepad(), GAMEPAD_PERIOD_MS);
  }

  /** @param {object} scene message */
  build(scene) {
    this.scene = scene.hand ? scene : null;
    this.anchor = new Vector3(...(scene.people.find((each) => each.seat === scene.own_seat)?.anchor_m ?? [0, 0, 0]));
    if (!this.scene) {
      this.own = null;
      this.letGo();
    }
  }

  /** Begin anew with another socket. */
  restart() {
    this.letGo();
    this.number = 0;
    this.own = null;
  }

  /** @param {import("./frames.js").OwnHand} own */
  show(own) {
    this.own = own;
    this.rumble();
  }

  get holds() {
    return this.target !== null;
  }

  /** Write a pointer message. @param {boolean} holds @param {number[]} target */
  write(holds, target) {
    this.number = (this.number + 1) >>> 0;
    this.sent_ms = performance.now();
    this.send(encodePointer(this.number, holds, target, this.keys | this.padButtons));
  }

  /** Take in buttons of a source. @param {"keys" | "padButtons"} source @param {number} down one bit each */
  hold(source, down) {
    if (!this.scene || !this.own || this[source] === down) return;
    this[source] = down;
    this.write(this.holds, this.target ?? this.own.position_m);
  }

  repeat() {
    if (performance.now() - this.sent_ms < REPEAT_MS - 5) return;
    if (this.holds) this.write(true, this.target);
    else if (this.own && this.keys | this.padButtons) this.write(false, this.own.position_m);
  }

  letGo() {
    if (this.holds) this.write(false, this.target);
    this.target = null;
    this.pointers.clear();
    this.changed();
  }

  /** Let go of the device and of all buttons. */
  leave() {
    this.hold("keys", 0);
    this.hold("padButtons", 0);
    this.letGo();
  }

  /** @returns {Vector3} where the device is drawn */
  device() {
    return new Vector3(...this.own.position_m).add(this.anchor);
  }

  ray(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const caster = new Raycaster();
    caster.setFromCamera(at, this.picture.orbit.camera);
    return caster;
  }

  /** @returns {boolean} the pointer is on the own device or on the object */
  grasps(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = this.picture.project(this.device());
    const near = Math.hypot(event.clientX - box.left - x, event.clientY - box.top - y);
    if (near <= (GRASP_PIXELS[event.pointerType] ?? GRASP_PIXELS.mouse)) return true;
    return this.ray(event).intersectObject(this.picture.body.surface).length > 0;
  }

  /** Point below the pointer: on the plane that faces the camera, or on what the object's axes span. @returns {Vector3 | null} */
  below(event) {
    const { ray } = this.ray(event);
    const view = this.picture.orbit.camera.getWorldDirection(new Vector3());
    const normal = view.clone();
    if (this.scene.axes === 2 && Math.abs(view.z) > 0.15) normal.set(0, 0, 1);
    if (this.scene.axes === 1) normal.setX(0); // the plane that holds the x axis and faces the camera most
    if (normal.length() < 0.05) return null;
    return ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(normal.normalize(), this.origin), new Vector3());
  }

  press(event) {
    if (!this.scene || !this.own) return;
    if (!this.holds && (event.button !== 0 || !this.grasps(event))) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, event.clientY);
    if (this.pointers.size > 1) return;
    this.origin = this.device();
    this.start = this.below(event);
    this.depth_m = 0;
    this.aim(event);
  }

  move(event) {
    const before_y = this.pointers.get(event.pointerId);
    if (before_y === undefined || !this.holds) return;
    event.stopImmediatePropagation();
    const [first] = this.pointers.keys();
    if (event.pointerId === first) {
      const coalesced = event.getCoalescedEvents?.() ?? [];
      for (const each of coalesced.length > 0 ? coalesced : [event]) this.aim(each);
    } else {
      this.depth_m += (before_y - event.clientY) * this.picture.orbit.metresPerPixel(); // a second finger: up is away
      this.aimAgain();
    }
    this.pointers.set(event.pointerId, event.clientY);
  }

  wheel(event) {
    if (!this.holds) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    this.depth_m -= event.deltaY * DEPTH_PER_WHEEL_PIXEL;
    this.aimAgain();
  }

  release(event) {
    if (!this.pointers.has(event.pointerId)) return;
    event.stopImmediatePropagation();
    const [first] = this.pointers.keys();
    this.pointers.delete(event.pointerId);
    if (event.pointerId === first) this.letGo();
  }

  aim(event) {
    const point = this.below(event);
    if (!point || !this.start) return;
    this.offset = point.sub(this.start);
    this.aimAgain();
  }

  aimAgain() {
    const view = this.picture.orbit.camera.getWorldDirection(new Vector3());
    this.pullTo(this.origin.clone().add(this.offset).addScaledVector(view, this.depth_m).sub(this.anchor));
  }

  /** @param {Vector3} target relative to the point held */
  pullTo(target) {
    const axes = this.scene.axes;
    const point = target.toArray().map((value, axis) => (axis < axes ? Math.min(Math.max(value, -FARTHEST_M), FARTHEST_M) : 0));
    if (!point.every(Number.isFinite)) return;
    this.target = point;
    this.write(true, point);
    this.changed();
  }

  /** A gamepad pulls while one of its lower buttons (A, shoulder) is pressed; the stick moves the target. */
  pollGamepad() {
    if (!this.scene || !this.own || document.hidden) return;
    const pad = (navigator.getGamepads?.() ?? []).find((each) => each?.connected);
    this.hold("padButtons", padBits(pad));
    if (this.pointers.size > 0) return;
    const pressed = pad && PULLS.some((button) => pad.buttons[button]?.pressed);
    if (this.gamepad && !pressed) this.letGo();
    this.gamepad = pressed ? pad : null;
    if (!pressed) return;
    const deflection = (axis) => (Math.abs(pad.axes[axis] ?? 0) > GAMEPAD_DEAD ? pad.axes[axis] : 0);
    const step = (GAMEPAD_MPS * GAMEPAD_PERIOD_MS) / 1000;
    const camera = this.picture.orbit.camera.matrixWorld;
    const target = new Vector3(...(this.target ?? this.own.position_m));
    [deflection(0), -deflection(1), deflection(3)].forEach((value, axis) => {
      target.addScaledVector(new Vector3().setFromMatrixColumn(camera, axis), step * value);
    });
    this.pullTo(target);
  }

  rumble() {
    const actuator = this.gamepad?.vibrationActuator;
    const now_ms = performance.now();
    if (!actuator || now_ms - this.rumbled_ms < RUMBLE_MS / 2) return;
    const share = Math.min(1, Math.hypot(...this.own.force_n) / this.own.limit_n);
    if (!(share > 0.02)) return;
    this.rumbled_ms = now_ms;
    actuator.playEffect("dual-rumble", { duration: RUMBLE_MS, strongMagnitude: share, weakMagnitude: share / 2 }).catch(() => {
      this.rumbled_ms = Infinity; // this browser shows the actuator and does not drive it
    });
  }
}
