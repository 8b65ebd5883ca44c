/** One person in the picture: device, proxy, the coupling stretched between them, force, name. */

import { CylinderGeometry, Group, Mesh, MeshLambertMaterial, MeshBasicMaterial, OctahedronGeometry, RingGeometry, SphereGeometry, Vector3, DoubleSide } from "three";
import { Arrow, Spring, Thread } from "./shapes.js";

/** Markers are drawn over the object: a proxy is often inside it. */
function drawOver(root, order) {
  root.traverse((each) => {
    each.renderOrder = order;
    if (!each.material) return;
    each.material.depthTest = false;
    each.material.transparent = true; // drawn after all that is not
  });
}

const finite = (values) => values.every(Number.isFinite);

export class PersonMarkers extends Group {
  /** @param {{seat: number, name: string, colour: string, anchor_m: number[]}} person @param {number} extent_m of the workspace */
  constructor(person, extent_m, own, colours) {
    super();
    this.person = person;
    this.device = new Mesh(new SphereGeometry((own ? 0.028 : 0.02) * extent_m, 20, 14), new MeshLambertMaterial({ color: person.colour }));
    this.proxy = new Mesh(new OctahedronGeometry(0.014 * extent_m), new MeshLambertMaterial({ color: person.colour }));
    this.contact = new Mesh(
      new RingGeometry(0.024 * extent_m, 0.03 * extent_m, 32),
      new MeshBasicMaterial({ color: colours.contactEdge, side: DoubleSide }),
    );
    this.coupling = new Spring(person.colour, 0.01 * extent_m);
    this.force = new Arrow(person.colour, 0.006 * extent_m);
    this.pull = new Thread(colours.text);
    this.handForce = new Arrow(colours.text, 0.005 * extent_m);
    this.handle = new Mesh(new CylinderGeometry(0.006 * extent_m, 0.003 * extent_m, 0.09 * extent_m, 12), this.device.material);
    this.handle.geometry.translate(0, 0.045 * extent_m, 0).rotateX(Math.PI / 2); // from the tip along its own z
    this.add(this.handle, this.coupling, this.device, this.proxy, this.contact, this.force, this.pull, this.handForce);
    drawOver(this, 2);
    drawOver(this.coupling, 1);
    this.visible = false;
  }

  /** @param {number[]} position relative to the point held @returns {Vector3} where it is drawn */
  place(position) {
    return new Vector3(...position.map((value, axis) => value + this.person.anchor_m[axis]));
  }

  /**
   * @param {import("./frames.js").Person} state
   * @param {import("./frames.js").OwnHand | null} own the device that this page's pointer pulls
   * @param {number} metresPerNewton
   */
  show(state, own, metresPerNewton) {
    this.visible = state.state !== "free" && finite(state.proxy_m);
    if (!this.visible) return;
    const hand_m = own ? own.position_m : state.hand_m;
    const known = (own !== null || state.hand_known) && finite(hand_m);
    this.proxy.position.copy(this.place(state.proxy_m));
    this.device.visible = known;
    if (known) this.device.position.copy(this.place(hand_m));
    this.handle.visible = known && finite(state.orientation);
    if (this.handle.visible) {
      const [w, x, y, z] = state.orientation;
      this.handle.quaternion.set(x, y, z, w);
      this.handle.position.copy(this.device.position);
    }
    this.device.scale.setScalar(state.buttons ? 1.35 : 1);
    if (known) this.coupling.span(this.device.position, this.proxy.position);
    else this.coupling.visible = false;
    this.contact.visible = state.pushes;
    this.contact.position.copy(this.proxy.position);
    this.force.point(this.proxy.position, arrow(state.force_n, metresPerNewton));
    this.handForce.visible = false;
    if (own) this.handForce.point(this.device.position, arrow(own.force_n, metresPerNewton));
  }

  /** Draw the pull from the device to the pointer's target. @param {number[] | null} target_m */
  showPull(target_m) {
    this.pull.visible = false;
    if (target_m && this.device.visible) this.pull.span(this.device.position, this.place(target_m));
  }
}

function arrow(force_n, metresPerNewton) {
  return finite(force_n) ? new Vector3(...force_n).multiplyScalar(metresPerNewton) : new Vector3();
}
