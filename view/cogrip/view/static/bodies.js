/** Bodies of a scene: its shapes in three.js, each body moved to its pose. */

import {
  BoxGeometry, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DoubleSide, EdgesGeometry, Float32BufferAttribute, FrontSide, Group,
  LineBasicMaterial, LineSegments, Mesh,
  MeshLambertMaterial, PlaneGeometry, Quaternion, SphereGeometry, Vector3,
} from "three";

const LEAST_M = 1e-4; // a side of nothing has no normal
const WIDEST = 0.75; // half the side of a plane as it is drawn, in workspaces: contact has no end, and a full picture is slow to draw

/** @typedef {{kind: string, size_m: number[], body: number | null, place_m: number[], orientation: number[], rgba: number[] | null, seat: number | null, object: boolean, triangles?: string}} Shape */

/** @param {Shape} shape @param {import("three").Box3} space that the camera takes in @returns {import("three").BufferGeometry} in the frame of its body */
export function shapeGeometry({ kind, size_m, place_m, orientation: [w, x, y, z], triangles }, space) {
  const [a, b, c] = size_m.map((each) => Math.max(each, LEAST_M));
  const turned = new Quaternion(x, y, z, w);
  const middle = () => space.getCenter(new Vector3()).sub(new Vector3(...place_m)).applyQuaternion(turned.clone().invert());
  const make = {
    box: () => new BoxGeometry(2 * a, 2 * b, 2 * c),
    sphere: () => new SphereGeometry(a, 24, 16),
    ellipsoid: () => new SphereGeometry(1, 24, 16).scale(a, b, c),
    capsule: () => new CapsuleGeometry(a, 2 * b, 8, 24).rotateX(Math.PI / 2), // its axis is z
    cylinder: () => new CylinderGeometry(a, a, 2 * b, 32).rotateX(Math.PI / 2),
    plane: () => planeGeometry(size_m, space.getSize(new Vector3()), middle()),
    mesh: () => surfaceGeometry(size_m, triangles ?? ""),
  }[kind];
  return make().applyQuaternion(turned).translate(...place_m);
}

/** Part of a mesh's surface. @param {string} triangles base64 of three corners each, 16 bits a coordinate: from -size_m to size_m */
function surfaceGeometry(size_m, triangles) {
  const bytes = Uint8Array.from(atob(triangles), (each) => each.charCodeAt(0));
  const counts = new DataView(bytes.buffer);
  const points = Float32Array.from({ length: bytes.length / 2 }, (_, index) => size_m[index % 3] * (counts.getUint16(2 * index, true) / 32767.5 - 1));
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  geometry.computeVertexNormals(); // no corner is shared, so each face has its own
  return geometry;
}

/** The part of a plane below the workspace. @param {Vector3} middle of the workspace, in the plane's frame */
function planeGeometry(size_m, workspace, middle) {
  const widest = WIDEST * Math.max(...workspace.toArray());
  const [x, y] = [0, 1].map((axis) => {
    const half = size_m[axis] > 0 ? size_m[axis] : Infinity;
    const part = Math.min(half, widest);
    return { side: 2 * part, at: Math.min(Math.max(middle.getComponent(axis), part - half), half - part) };
  });
  return new PlaneGeometry(x.side, y.side).translate(x.at, y.at, 0);
}

/** @param {Shape[]} shapes @param {import("three").Box3} space @returns {import("three").BufferGeometry[]} those of the object */
export function objectGeometries(shapes, space) {
  return shapes.filter((each) => each.object).map((each) => shapeGeometry(each, space));
}

export class DrawnShape extends Group {
  /** @param {Shape} shape @param {string | undefined} own colour of the person whose tool it is */
  constructor(shape, own, space, colours) {
    super();
    this.shape = shape;
    const geometry = shapeGeometry(shape, space);
    const plane = shape.kind === "plane";
    const [red, green, blue, alpha] = shape.rgba ?? [0, 0, 0, plane ? 0.35 : 1];
    this.colour = own ? new Color(own) : shape.rgba ? new Color().setRGB(red, green, blue, "srgb") : new Color(shape.body === null ? colours.fixed : colours.object);
    const seenThrough = !own && alpha < 1;
    this.material = new MeshLambertMaterial({ transparent: seenThrough, opacity: own ? 1 : alpha, side: plane ? DoubleSide : FrontSide, depthWrite: !seenThrough, polygonOffset: plane, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    this.add(new Mesh(geometry, this.material));
    this.edges = new LineBasicMaterial();
    if (["box", "cylinder"].includes(shape.kind) && !own) this.add(new LineSegments(new EdgesGeometry(geometry, 30), this.edges));
    this.paint(colours, false);
  }

  paint(colours, contact) {
    const lit = contact && this.shape.object;
    this.material.color.set(lit ? colours.contact : this.colour);
    this.edges.color.set(lit ? colours.contactEdge : colours.edge);
  }
}

/** All shapes of a scene. Tools are drawn while somebody holds them. */
export class SceneBodies extends Group {
  /** @param {object} scene message @param {import("three").Box3} space that the camera takes in */
  constructor(scene, space, colours) {
    super();
    const people = new Map(scene.people.map((each) => [each.seat, each.colour]));
    this.shapes = scene.geoms.map((shape) => new DrawnShape(shape, people.get(shape.seat), space, colours));
    this.bodies = [];
    for (const each of this.shapes) {
      const { body } = each.shape;
      if (body === null) this.add(each);
      else (this.bodies[body] ??= new Group()).add(each);
    }
    this.bodies = Array.from(this.bodies, (each) => each ?? new Group());
    for (const each of this.bodies) this.add(each);
  }

  /** @param {import("./frames.js").Frame} frame */
  show(frame, colours) {
    const held = new Set(frame.people.filter((each) => !["free", "joining"].includes(each.state)).map((each) => each.seat));
    for (const each of this.shapes) {
      each.visible = each.shape.seat === null || held.has(each.shape.seat);
      each.paint(colours, frame.contact);
    }
    this.bodies.forEach((body, number) => {
      const pose = frame.bodies[number];
      body.visible = pose !== undefined && [...pose.position_m, ...pose.orientation].every(Number.isFinite);
      if (!body.visible) return;
      const [w, x, y, z] = pose.orientation;
      body.position.set(...pose.position_m);
      body.quaternion.set(x, y, z, w);
    });
  }

  /** @returns {({position_m: number[], orientation: number[], visible: boolean})[]} as they were drawn */
  drawn() {
    const turned = new Quaternion();
    return this.bodies.map((body) => {
      body.matrixWorld.decompose(new Vector3(), turned, new Vector3());
      const shown = body.visible && body.children.some((each) => each.visible);
      return { position_m: new Vector3().setFromMatrixPosition(body.matrixWorld).toArray(), orientation: [turned.w, turned.x, turned.y, turned.z], visible: shown };
    });
  }
}
