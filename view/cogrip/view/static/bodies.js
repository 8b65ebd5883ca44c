/** Bodies of a scene: its shapes in three.js, each body moved to its pose. */

import {
  BoxGeometry, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DataTexture, DoubleSide, EdgesGeometry, Float32BufferAttribute, FrontSide, Group,
  InstancedMesh, LineBasicMaterial, LineSegments, Matrix4, Mesh,
  MeshLambertMaterial, LinearMipmapLinearFilter, PlaneGeometry, Quaternion, RepeatWrapping, SRGBColorSpace, SphereGeometry, Vector3,
} from "three";

const UP = new Vector3(0, 1, 0); // axis of three.js's cylinders
const LEAST_M = 1e-4; // a side of nothing has no normal
const TILE = 18; // colours along each side of a plane's tile
const WIDEST = 0.75; // half the side of a plane as it is drawn, in workspaces: contact has no end, and a full picture is slow to draw

/** @typedef {{kind: string, size_m: number[], body: number | null, place_m: number[], orientation: number[], rgba: number[] | null, seat: number | null, object: boolean, triangles?: string, colours?: string, points?: string, period_m?: number[]}} Shape */

/** @param {Shape} shape @param {import("three").Box3} space that the camera takes in @returns {import("three").BufferGeometry} in the frame of its body */
export function shapeGeometry({ kind, size_m, place_m, orientation: [w, x, y, z], triangles, colours, period_m }, space) {
  const [a, b, c] = size_m.map((each) => Math.max(each, LEAST_M));
  const turned = new Quaternion(x, y, z, w);
  const middle = () => space.getCenter(new Vector3()).sub(new Vector3(...place_m)).applyQuaternion(turned.clone().invert());
  const make = {
    box: () => new BoxGeometry(2 * a, 2 * b, 2 * c),
    sphere: () => new SphereGeometry(a, 24, 16),
    ellipsoid: () => new SphereGeometry(1, 24, 16).scale(a, b, c),
    capsule: () => new CapsuleGeometry(a, 2 * b, 8, 24).rotateX(Math.PI / 2), // its axis is z
    cylinder: () => new CylinderGeometry(a, a, 2 * b, 32).rotateX(Math.PI / 2),
    plane: () => planeGeometry(size_m, space.getSize(new Vector3()), middle(), period_m),
    mesh: () => surfaceGeometry(size_m, triangles ?? "", colours),
  }[kind];
  return make().applyQuaternion(turned).translate(...place_m);
}

/** @param {string} [packed] base64 of unsigned 16-bit numbers */
function numbersOf(packed = "") {
  const view = new DataView(bytesOf(packed).buffer);
  return Array.from({ length: view.byteLength / 2 }, (_, index) => view.getUint16(2 * index, true));
}

/** @param {string} packed base64 */
function bytesOf(packed) {
  return Uint8Array.from(atob(packed), (each) => each.charCodeAt(0));
}

/** Part of a mesh's surface. @param {string} triangles base64 of three corners each, 16 bits a coordinate: from -size_m to size_m */
function surfaceGeometry(size_m, triangles, colours) {
  const points = Float32Array.from(numbersOf(triangles), (count, index) => size_m[index % 3] * (count / 32767.5 - 1));
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  if (colours) geometry.setAttribute("color", new Float32BufferAttribute(cornerColours(bytesOf(colours)), 3));
  geometry.computeVertexNormals(); // no corner is shared, so each face has its own
  return geometry;
}

/** @param {Uint8Array} bytes red, green, blue of each triangle @returns {number[]} of each corner, as three.js reckons */
function cornerColours(bytes) {
  const found = [];
  for (let at = 0; at < bytes.length; at += 3) {
    const rgb = new Color().setRGB(bytes[at] / 255, bytes[at + 1] / 255, bytes[at + 2] / 255, "srgb").toArray();
    found.push(...rgb, ...rgb, ...rgb);
  }
  return found;
}

/** A tile that repeats on a plane. @param {string} colours base64 of red, green, blue of its cells */
function tileTexture(colours) {
  const bytes = bytesOf(colours);
  const cells = Uint8Array.from({ length: 4 * TILE * TILE }, (_, at) => (at % 4 === 3 ? 255 : bytes[3 * (at >> 2) + (at % 4)]));
  const texture = new DataTexture(cells, TILE, TILE);
  Object.assign(texture, { colorSpace: SRGBColorSpace, wrapS: RepeatWrapping, wrapT: RepeatWrapping, minFilter: LinearMipmapLinearFilter, generateMipmaps: true, anisotropy: 4, needsUpdate: true });
  return texture;
}

/** The part of a plane below the workspace. @param {Vector3} middle of the workspace, in the plane's frame */
function planeGeometry(size_m, workspace, middle, [across, along] = [1, 1]) {
  const widest = WIDEST * Math.max(...workspace.toArray());
  const [x, y] = [0, 1].map((axis) => {
    const half = size_m[axis] > 0 ? size_m[axis] : Infinity;
    const part = Math.min(half, widest);
    return { side: 2 * part, at: Math.min(Math.max(middle.getComponent(axis), part - half), half - part) };
  });
  const geometry = new PlaneGeometry(x.side, y.side).translate(x.at, y.at, 0);
  const [places, uv] = ["position", "uv"].map((name) => geometry.getAttribute(name));
  for (let at = 0; at < uv.count; at += 1) {
    const [u, v] = [places.getX(at) / across, -places.getY(at) / along];
    uv.setXY(at, u + (size_m[0] > 0 ? size_m[0] / across : 0.5), v + (size_m[1] > 0 ? size_m[1] / along : 0.5));
  }
  return geometry;
}

/** @param {Shape[]} shapes @param {import("three").Box3} space @returns {import("three").BufferGeometry[]} those of the object */
export function objectGeometries(shapes, space) {
  return shapes.filter((each) => each.object).map((each) => shapeGeometry(each, space));
}

/** @param {Shape} shape @param {string | undefined} own @returns {{colour: Color, look: object}} its colour, and how its material is made */
function lookOf(shape, own, colours) {
  const [red, green, blue, alpha] = shape.rgba ?? [0, 0, 0, shape.kind === "plane" ? 0.35 : 1];
  const fixed = shape.body === null && !(shape.kind in OF_POINTS);
  const colour = own ? new Color(own) : shape.rgba ? new Color().setRGB(red, green, blue, "srgb") : new Color(fixed ? colours.fixed : colours.object);
  const seenThrough = !own && alpha < 1;
  return { colour, look: { transparent: seenThrough, opacity: own ? 1 : alpha, depthWrite: !seenThrough } };
}

/** A flexible body: triangles between points that move. */
class FlexShape extends Group {
  /** @param {Shape} shape */
  constructor(shape, colours) {
    super();
    this.shape = shape;
    this.points = numbersOf(shape.points);
    const { colour, look } = lookOf(shape, undefined, colours);
    this.places = new Float32BufferAttribute(new Float32Array(3 * this.points.length), 3);
    this.surface = new Mesh(new BufferGeometry().setAttribute("position", this.places), new MeshLambertMaterial({ color: colour, side: DoubleSide, ...look }));
    this.surface.frustumCulled = false; // its points move
    this.add(this.surface);
  }

  paint() {}

  /** @param {number[][]} places of all its points */
  move(places) {
    places.forEach((place, index) => this.places.setXYZ(index, ...place));
    this.places.needsUpdate = true;
    this.surface.geometry.computeVertexNormals();
  }
}

/** A tendon: a round line through points that move. */
class TendonShape extends Group {
  /** @param {Shape} shape */
  constructor(shape, colours) {
    super();
    this.shape = shape;
    this.points = numbersOf(shape.points);
    const { colour, look } = lookOf(shape, undefined, colours);
    const material = new MeshLambertMaterial({ color: colour, ...look });
    this.radius_m = Math.max(shape.size_m[0], LEAST_M);
    this.pieces = new InstancedMesh(new CylinderGeometry(1, 1, 1, 12, 1, true), material, Math.max(0, this.points.length - 1));
    this.knots = new InstancedMesh(new SphereGeometry(1, 12, 8), material, this.points.length);
    for (const each of [this.pieces, this.knots]) each.frustumCulled = false;
    this.add(this.pieces, this.knots);
  }

  paint() {}

  /** @param {number[][]} places of all its points */
  move(places) {
    const at = places.map((place) => new Vector3(...place));
    const unturned = new Quaternion();
    const round = new Vector3().setScalar(this.radius_m);
    at.forEach((place, index) => this.knots.setMatrixAt(index, new Matrix4().compose(place, unturned, round)));
    for (let index = 0; index + 1 < at.length; index += 1) {
      const along = at[index + 1].clone().sub(at[index]);
      const length = Math.max(along.length(), 1e-9); // points of one place: the path is shorter now than it can be
      const turned = new Quaternion().setFromUnitVectors(UP, along.divideScalar(length));
      const middle = at[index].clone().add(at[index + 1]).divideScalar(2);
      this.pieces.setMatrixAt(index, new Matrix4().compose(middle, turned, new Vector3(this.radius_m, length, this.radius_m)));
    }
    for (const each of [this.pieces, this.knots]) each.instanceMatrix.needsUpdate = true;
  }
}

const OF_POINTS = { flex: FlexShape, tendon: TendonShape };

export class DrawnShape extends Group {
  /** @param {Shape} shape @param {string | undefined} own colour of the person whose tool it is */
  constructor(shape, own, space, colours) {
    super();
    this.shape = shape;
    const geometry = shapeGeometry(shape, space);
    const plane = shape.kind === "plane";
    const { colour, look } = lookOf(shape, own, colours);
    const painted = shape.colours && !own;
    if (painted) Object.assign(look, plane ? { map: tileTexture(shape.colours) } : { vertexColors: true });
    this.colour = painted ? new Color(1, 1, 1) : colour; // what a texture is multiplied by
    this.material = new MeshLambertMaterial({ side: plane ? DoubleSide : FrontSide, polygonOffset: plane, polygonOffsetFactor: 1, polygonOffsetUnits: 1, ...look });
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
    this.shapes = scene.geoms.map((shape) => (shape.kind in OF_POINTS ? new OF_POINTS[shape.kind](shape, colours) : new DrawnShape(shape, people.get(shape.seat), space, colours)));
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
      if (!each.points) continue;
      const places = each.points.map((number) => frame.bodies[number]?.position_m ?? [NaN]);
      each.visible = places.flat().every(Number.isFinite);
      if (each.visible) each.move(places);
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
