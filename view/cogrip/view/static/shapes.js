/** Bodies of the scene in three.js: the object, fixed geometry, grid and axes, arrows, lines and springs. */

import {
  BoxGeometry, BufferGeometry, ConeGeometry, CylinderGeometry, DoubleSide, EdgesGeometry, Float32BufferAttribute, Group, Line,
  LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial, PlaneGeometry, Quaternion, SphereGeometry, Vector3,
} from "three";

const UP = new Vector3(0, 1, 0); // axis of three.js's cones and cylinders
const X = new Vector3(1, 0, 0);
const SPRING_POINTS = 96;
const SPRING_TURNS = 8;

/** @param {{shape: string, size_m: number[]}} object @param {number} meridians of a sphere @returns {BufferGeometry} */
function objectGeometry({ shape, size_m }, meridians = 32) {
  const [x, y, z] = size_m.map((side) => Math.max(side, 1e-4));
  if (shape === "sphere") {
    const geometry = new SphereGeometry(0.5, meridians, meridians / 2);
    geometry.scale(x, y, z);
    return geometry;
  }
  return new BoxGeometry(x, y, z);
}

/** The shared object: a body with its edges. A wall is seen through. */
export class Body extends Group {
  constructor(object, colours) {
    super();
    const geometry = objectGeometry(object);
    const wall = object.shape === "wall";
    this.surface = new Mesh(geometry, new MeshLambertMaterial({ transparent: wall, opacity: wall ? 0.45 : 1 }));
    this.add(this.surface);
    this.edges = new LineSegments(new EdgesGeometry(geometry, 30), new LineBasicMaterial());
    if (object.shape !== "sphere") this.add(this.edges);
    this.paint(colours, false);
  }

  paint(colours, contact) {
    this.surface.material.color.set(contact ? colours.contact : colours.object);
    this.edges.material.color.set(contact ? colours.contactEdge : colours.edge);
  }
}

/** Another person's picture of the object: its edges in the person's colour. */
export class Ghost extends Group {
  /** @param {object} object @param {BufferGeometry[] | null} shapes that it has in a scene */
  constructor(object, shapes) {
    super();
    this.line = new LineBasicMaterial();
    this.film = new MeshBasicMaterial({ transparent: true, opacity: 0.16, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    for (const each of shapes ?? [objectGeometry(object, 12)]) this.add(new LineSegments(new EdgesGeometry(each, 1), this.line));
    for (const each of shapes ?? [objectGeometry(object)]) this.add(new Mesh(each, this.film));
    this.visible = false;
  }

  paint(colour) {
    this.line.color.set(colour);
    this.film.color.set(colour);
  }
}

/** @param {{shape: string, position_m: number[], normal: number[], size_m: number[]}} fixed @returns {Group} */
export function fixedBody(fixed, colours) {
  const [x, y, z] = fixed.size_m;
  const group = new Group();
  const geometry = fixed.shape === "plane" ? new PlaneGeometry(z, y).rotateY(Math.PI / 2) : new BoxGeometry(x, y, z);
  const material = new MeshLambertMaterial({ color: colours.fixed, transparent: true, opacity: 0.35, side: DoubleSide, depthWrite: false });
  group.add(new Mesh(geometry, material));
  group.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: colours.edge })));
  group.quaternion.setFromUnitVectors(X, new Vector3(...fixed.normal).normalize());
  group.position.set(...fixed.position_m);
  return group;
}

/**
 * The place of a goal, seen through: a ball where it is given on three axes, on fewer a slab or bar across the workspace.
 * @param {{place_m: number[], within_m: number}} goal @param {number[][]} workspace lowest and highest of each axis [m] @returns {Group}
 */
export function targetBody({ place_m, within_m }, workspace, colours) {
  const group = new Group();
  const given = (axis) => axis < place_m.length;
  group.size_m = workspace.map(([low, high], axis) => (given(axis) ? 2 * within_m : high - low));
  const geometry = given(2) ? new SphereGeometry(within_m, 24, 12) : new BoxGeometry(...group.size_m);
  const film = { color: colours.target, transparent: true, opacity: 0.22, side: DoubleSide, depthWrite: false };
  group.add(new Mesh(geometry, new MeshBasicMaterial(film)));
  group.add(new LineSegments(new EdgesGeometry(geometry, 30), new LineBasicMaterial({ color: colours.target })));
  group.position.set(...workspace.map(([low, high], axis) => (given(axis) ? place_m[axis] : (low + high) / 2)));
  return group;
}

/** @param {Float32Array | number[]} points x, y, z one behind the other */
function segments(points, colour) {
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: colour }));
}

/** @returns {number} the largest of 1, 2, 5 times a power of ten that is not above `value` */
export function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((step) => step * power <= value * (1 + 1e-9)) * power;
}

/** Grid below the workspace and the axes in its corner. @param {number[][]} workspace lowest and highest of each axis [m] */
export function gridAndAxes(workspace, step_m, colours) {
  const group = new Group();
  const low = workspace.map(([least]) => Math.floor(least / step_m + 1e-9) * step_m);
  const high = workspace.map(([, most]) => Math.ceil(most / step_m - 1e-9) * step_m);
  const lines = [];
  for (let x = low[0]; x <= high[0] + step_m / 2; x += step_m) lines.push(x, low[1], low[2], x, high[1], low[2]);
  for (let y = low[1]; y <= high[1] + step_m / 2; y += step_m) lines.push(low[0], y, low[2], high[0], y, low[2]);
  group.add(segments(lines, colours.grid));
  const length = 0.25 * Math.max(...workspace.map(([least, most]) => most - least));
  const names = ["x", "y", "z"];
  const corner = new Vector3(low[0], low[1], low[2] + 0.01 * length); // above the grid's own lines
  group.axisEnds = names.map((_, axis) => new Vector3().setComponent(axis, length).add(corner));
  group.axisEnds.forEach((end, axis) => group.add(segments([...corner.toArray(), ...end.toArray()], colours[names[axis]])));
  return group;
}

/** An arrow of a shaft and a head, from a point along a vector. */
export class Arrow extends Group {
  constructor(colour, thickness_m) {
    super();
    const material = new MeshBasicMaterial({ color: colour });
    this.thickness_m = thickness_m;
    this.shaft = new Mesh(new CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0), material);
    this.head = new Mesh(new ConeGeometry(1, 1, 14).translate(0, -0.5, 0), material);
    this.add(this.shaft, this.head);
    this.visible = false;
  }

  /** @param {Vector3} from @param {Vector3} along its length is the arrow's [m] */
  point(from, along) {
    const length = along.length();
    this.visible = length > 0.5 * this.thickness_m;
    if (!this.visible) return;
    const head = Math.min(5 * this.thickness_m, 0.6 * length);
    const width = Math.min(this.thickness_m, length / 3);
    this.position.copy(from);
    this.quaternion.setFromUnitVectors(UP, along.clone().divideScalar(length));
    this.shaft.scale.set(width, length - head, width);
    this.head.scale.set(2.2 * width, head, 2.2 * width);
    this.head.position.set(0, length, 0);
  }
}

/** A spring of fixed turns between two points: the stretched coupling. */
export class Spring extends Line {
  constructor(colour, radius_m) {
    const points = new Float32BufferAttribute(new Float32Array(3 * SPRING_POINTS), 3);
    super(new BufferGeometry().setAttribute("position", points), new LineBasicMaterial({ color: colour }));
    this.radius_m = radius_m;
    this.frustumCulled = false;
  }

  /** @param {Vector3} from @param {Vector3} to */
  span(from, to) {
    const along = to.clone().sub(from);
    const length = along.length();
    this.visible = length > 1e-6;
    if (!this.visible) return;
    const turn = new Quaternion().setFromUnitVectors(UP, along.clone().divideScalar(length));
    const radius = Math.min(this.radius_m, length / 3);
    const points = this.geometry.getAttribute("position");
    const point = new Vector3();
    for (let index = 0; index < SPRING_POINTS; index += 1) {
      const share = index / (SPRING_POINTS - 1);
      const inside = Math.min(1, Math.max(0, (share - 0.12) / 0.76)); // straight at both ends
      const wide = inside > 0 && inside < 1 ? radius : 0;
      const angle = 2 * Math.PI * SPRING_TURNS * inside;
      point.set(wide * Math.cos(angle), share * length, wide * Math.sin(angle)).applyQuaternion(turn).add(from);
      points.setXYZ(index, point.x, point.y, point.z);
    }
    points.needsUpdate = true;
  }
}

/** A thin straight line. */
export class Thread extends Line {
  constructor(colour) {
    super(new BufferGeometry().setAttribute("position", new Float32BufferAttribute(new Float32Array(6), 3)), new LineBasicMaterial({ color: colour }));
    this.frustumCulled = false;
    this.visible = false;
  }

  span(from, to) {
    const points = this.geometry.getAttribute("position");
    points.setXYZ(0, from.x, from.y, from.z);
    points.setXYZ(1, to.x, to.y, to.z);
    points.needsUpdate = true;
    this.visible = true;
  }
}
