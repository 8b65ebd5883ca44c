/** Names in the picture: text over the canvas, moved with what it names. */

const OFFSET_PIXELS = [10, -20];
const HEIGHT_PIXELS = 17; // of a label
const LETTER_PIXELS = 7.5; // a broad one: to ask the browser for a width would lay out the page in every picture

export class Labels {
  /** @param {HTMLElement} layer over the canvas */
  constructor(layer) {
    this.layer = layer;
    this.people = new Map();
  }

  build(scene) {
    this.layer.replaceChildren();
    this.people.clear();
    for (const person of scene.people) {
      const label = this.add(person.name, "label");
      label.style.borderColor = person.colour;
      this.people.set(person.seat, label);
    }
    this.ghost = this.add("", "label ghost");
    this.axes = ["x", "y", "z"].map((name) => this.add(name, `label axis ${name}`));
  }

  /** @param {string} text @param {string} className */
  add(text, className) {
    const label = document.createElement("span");
    label.textContent = text;
    label.className = className;
    this.layer.append(label);
    return label;
  }

  /** @param {import("./picture.js").Picture} picture */
  place(picture) {
    if (!this.axes) return;
    const taken = [];
    for (const [seat, label] of this.people) {
      const { visible, device, proxy } = picture.people.get(seat);
      this.move(label, visible ? (device.visible ? device : proxy).position : null, picture, OFFSET_PIXELS, taken);
    }
    const { ghost, ghostSeat } = picture;
    const name = picture.people.get(ghostSeat)?.person.name;
    if (name) this.ghost.textContent = `as ${name} is shown it`;
    const below = (0.75 * Math.max(...picture.scene.object.size_m)) / picture.orbit.metresPerPixel();
    this.move(this.ghost, ghost.visible ? ghost.position : null, picture, [-50, below], taken);
    this.axes.forEach((label, axis) => this.move(label, picture.axisEnds[axis], picture, [3, -8]));
  }

  /** Put a label beside a point, below those in `taken`, where they would overlap. */
  move(label, point, picture, [right, down], taken = []) {
    label.hidden = point === null;
    if (point === null) return;
    const [x, y] = picture.project(point);
    const place = { left: x + right, top: y + down, width: 10 + LETTER_PIXELS * label.textContent.length };
    for (const each of taken.sort((one, other) => one.top - other.top)) {
      const beside = place.left + place.width < each.left || each.left + each.width < place.left;
      if (!beside && Math.abs(place.top - each.top) < HEIGHT_PIXELS) place.top = each.top + HEIGHT_PIXELS;
    }
    taken.push(place);
    label.style.transform = `translate(${place.left.toFixed(1)}px, ${place.top.toFixed(1)}px)`;
  }
}
