/** The camera: z is up, x toward the user, y to the right. Presets, and an orbit by mouse, pen or fingers. */

import { MathUtils, PerspectiveCamera, Vector3 } from "three";

/** Azimuth about z from x, and elevation [degrees]. From the side, x runs to the right. */
export const PRESETS = {
  front: [0, 8],
  side: [-90, 8],
  top: [0, 89.9],
  iso: [-50, 28],
};
const FIELD_OF_VIEW_DEG = 35;
const FILL = 0.86; // of the picture, by the workspace
const CORNERS = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) => [x, y, z])));
const ROTATE_RAD_PER_PIXEL = 0.007;
const ZOOM_PER_WHEEL_PIXEL = 0.0012;
const STEEPEST_RAD = MathUtils.degToRad(89.9);

export class OrbitCamera {
  /** @param {HTMLElement} element that the user drags on @param {() => void} moved */
  constructor(element, moved) {
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.001, 100);
    this.camera.up.set(0, 0, 1);
    this.element = element;
    this.moved = moved;
    this.target = new Vector3();
    this.extent_m = 0.2;
    this.half = new Vector3(0.1, 0.1, 0.1);
    this.pointers = new Map();
    this.distance = 1;
    this.preset("iso");
    element.addEventListener("pointerdown", (event) => this.press(event));
    element.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    }
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** @param {keyof typeof PRESETS} name */
  preset(name) {
    const [azimuth, elevation] = PRESETS[name];
    this.azimuth = MathUtils.degToRad(azimuth);
    this.elevation = MathUtils.degToRad(elevation);
    this.target.copy(this.centre ?? this.target);
    this.fit();
  }

  /** Look at a box. @param {import("three").Box3} box */
  lookAt(box) {
    this.centre = box.getCenter(new Vector3());
    this.target.copy(this.centre);
    this.half = box.getSize(new Vector3()).divideScalar(2);
    this.extent_m = 2 * Math.max(...this.half.toArray());
  }

  /** Go as near as all corners of the box allow. */
  fit() {
    this.update(); // turns the camera
    const tangent = FILL * Math.tan(MathUtils.degToRad(FIELD_OF_VIEW_DEG / 2));
    const toCamera = this.camera.quaternion.clone().invert();
    const distances = CORNERS.map((signs) => {
      const { x, y, z } = new Vector3(...signs).multiply(this.half).applyQuaternion(toCamera);
      return z + Math.max(Math.abs(y), Math.abs(x) / this.camera.aspect) / tangent;
    });
    this.distance = Math.max(...distances);
    this.update();
  }

  /** @param {number} width @param {number} height of the picture [CSS pixels] */
  resize(width, height) {
    const before = Math.min(1, this.camera.aspect);
    this.camera.aspect = width / Math.max(1, height);
    this.distance *= before / Math.min(1, this.camera.aspect);
    this.height = height;
    this.update();
  }

  /** @returns {number} metres that a CSS pixel shows at the target */
  metresPerPixel() {
    return (2 * this.distance * Math.tan(MathUtils.degToRad(FIELD_OF_VIEW_DEG / 2))) / Math.max(1, this.height ?? 1);
  }

  update() {
    const flat = Math.cos(this.elevation) * this.distance;
    this.camera.position.set(
      this.target.x + flat * Math.cos(this.azimuth),
      this.target.y + flat * Math.sin(this.azimuth),
      this.target.z + this.distance * Math.sin(this.elevation),
    );
    this.camera.near = this.distance / 100;
    this.camera.far = this.distance * 20;
    this.camera.lookAt(this.target);
    this.camera.updateMatrixWorld();
    this.camera.updateProjectionMatrix();
    this.moved();
  }

  rotate(right, down) {
    this.azimuth -= right * ROTATE_RAD_PER_PIXEL;
    this.elevation = MathUtils.clamp(this.elevation + down * ROTATE_RAD_PER_PIXEL, -STEEPEST_RAD, STEEPEST_RAD);
  }

  pan(right, down) {
    const scale = this.metresPerPixel();
    this.target.addScaledVector(new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0), -right * scale);
    this.target.addScaledVector(new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1), down * scale);
  }

  zoom(factor) {
    this.distance = MathUtils.clamp(this.distance * factor, 0.1 * this.extent_m, 30 * this.extent_m);
  }

  press(event) {
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const right = event.clientX - before[0];
    const down = event.clientY - before[1];
    if (this.pointers.size === 2) {
      const [, other] = [...this.pointers].find(([id]) => id !== event.pointerId);
      const apart = Math.hypot(before[0] - other[0], before[1] - other[1]);
      const now = Math.hypot(event.clientX - other[0], event.clientY - other[1]);
      this.zoom(apart / Math.max(1, now));
      this.pan(right / 2, down / 2);
    } else if (event.buttons & 6 || event.shiftKey) {
      this.pan(right, down);
    } else {
      this.rotate(right, down);
    }
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.update();
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(event.deltaY * ZOOM_PER_WHEEL_PIXEL));
    this.update();
  }
}
