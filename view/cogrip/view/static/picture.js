/** The 3D picture of a session: builds it from the scene message, moves it to the newest frame, draws it. */

import { AmbientLight, DirectionalLight, Scene, Vector2, Vector3, WebGLRenderer, Box3 } from "three";
import { DrawnShape, SceneBodies, objectGeometries } from "./bodies.js";
import { OrbitCamera } from "./camera.js";
import { Labels } from "./labels.js";
import { PersonMarkers } from "./person.js";
import { Body, Ghost, fixedBody, gridAndAxes, roundDown, targetBody } from "./shapes.js";

const COLOURS = ["background", "text", "object", "edge", "contact", "contactEdge", "fixed", "grid", "target", "x", "y", "z"];
const ARROW_SHARE = 0.3; // of the workspace, that the largest force may be long
const MOST_PIXEL_RATIO = 2;
const GHOST_AWAY = 0.001; // of the workspace: nearer to the object, both would flicker in one place

/** @returns {Record<string, string>} colours of the picture, from the style sheet */
function themeColours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--scene-${name}`).trim()]));
}

/** @returns {boolean} no graphics card draws here: smooth edges would cost most of the pictures a second */
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl?.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}

export class Picture {
  /** @param {HTMLElement} stage @param {HTMLCanvasElement} canvas @param {HTMLElement} labels @param {() => void} changed */
  constructor(stage, canvas, labels, changed) {
    this.stage = stage;
    this.changed = changed;
    const software = drawsInSoftware();
    this.renderer = new WebGLRenderer({ canvas, antialias: !software });
    this.renderer.setPixelRatio(software ? 1 : Math.min(window.devicePixelRatio, MOST_PIXEL_RATIO));
    this.labels = new Labels(labels);
    this.world = new Scene();
    this.orbit = new OrbitCamera(canvas, changed);
    this.people = new Map();
    this.ghostSeat = null;
    this.goal = null;
    this.target = null;
    this.forceAtFullLength_n = 1;
    new ResizeObserver(() => this.resize()).observe(stage);
    this.resize();
  }

  resize() {
    const { clientWidth, clientHeight } = this.stage;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.size = new Vector2(clientWidth, clientHeight);
    this.orbit.resize(clientWidth, clientHeight);
  }

  /** Build all that does not change from frame to frame. @param {object} scene message @param {boolean} keepCamera */
  build(scene, keepCamera) {
    this.scene = scene;
    const colours = themeColours();
    this.colours = colours;
    this.world.traverse((each) => {
      each.geometry?.dispose();
      each.material?.map?.dispose();
      each.material?.dispose();
    });
    this.world.clear();
    this.renderer.setClearColor(colours.background);
    const box = new Box3(...[0, 1].map((end) => new Vector3(...scene.workspace_m.map((range) => range[end]))));
    this.extent_m = Math.max(...box.getSize(new Vector3()).toArray());
    this.gridStep_m = roundDown(this.extent_m / 8);
    this.grid = gridAndAxes(scene.workspace_m, this.gridStep_m, colours);
    this.axisEnds = this.grid.axisEnds;
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, -3, 5);
    this.body = new Body(scene.object, colours);
    const shapes = scene.geoms ?? [];
    this.bodies = shapes.length > 0 ? new SceneBodies(scene, box, colours) : null;
    this.ghost = new Ghost(scene.object, this.bodies && objectGeometries(shapes, box));
    this.world.add(new AmbientLight(0xffffff, 1.6), sun, this.grid, this.bodies ?? this.body, this.ghost);
    for (const each of scene.geometry) this.world.add(fixedBody(each, colours));
    for (const each of scene.effects ?? []) this.world.add(new DrawnShape(each, undefined, box, colours));
    this.target = null; // it was cleared with the rest
    this.aim(this.goal);
    this.people.clear();
    for (const person of scene.people) {
      const markers = new PersonMarkers(person, this.extent_m, person.seat === scene.own_seat, colours);
      this.people.set(person.seat, markers);
      this.world.add(markers);
    }
    this.labels.build(scene);
    if (!keepCamera) {
      this.orbit.lookAt(box);
      this.orbit.preset({ 1: "side", 2: "top" }[scene.axes] ?? "iso");
    }
    this.changed();
  }

  /** Draw where the object's place is to be. @param {{place_m: number[], within_m: number} | null} goal */
  aim(goal) {
    this.goal = goal ?? null;
    if (this.target) this.world.remove(this.target);
    this.target = null;
    if (!this.goal || !this.scene) return;
    this.target = targetBody(this.goal, this.scene.workspace_m, this.colours);
    this.world.add(this.target);
  }

  /** @returns {number} length of an arrow of 1 N [m] */
  get metresPerNewton() {
    return (ARROW_SHARE * (this.extent_m ?? 1)) / this.forceAtFullLength_n;
  }

  /** @param {number} factor by which arrows get longer */
  scaleArrows(factor) {
    this.forceAtFullLength_n = Math.max(0.01, this.forceAtFullLength_n / factor);
    this.changed();
  }

  /** Let the largest arrow fit. @param {import("./frames.js").Frame} frame */
  fitArrows(frame) {
    const forces = frame.people.map((each) => Math.hypot(...each.force_n)).filter(Number.isFinite);
    while (Math.max(0, ...forces) > 1.2 * this.forceAtFullLength_n) this.forceAtFullLength_n *= 2;
  }

  /**
   * Move everything to a frame.
   * @param {import("./frames.js").Frame} frame
   * @param {import("./frames.js").OwnHand | null} own
   * @param {number[] | null} target_m of the pointer, while it holds
   */
  show(frame, own, target_m) {
    this.fitArrows(frame);
    this.body.position.set(...frame.position_m);
    const [w, x, y, z] = frame.orientation;
    this.body.quaternion.set(x, y, z, w);
    this.body.paint(this.colours, frame.contact);
    this.bodies?.show(frame, this.colours);
    this.ghost.visible = false;
    for (const markers of this.people.values()) markers.visible = false;
    for (const state of frame.people) {
      const markers = this.people.get(state.seat);
      if (!markers) continue;
      const isOwn = own !== null && state.seat === this.scene.own_seat;
      markers.show(state, isOwn ? own : null, this.metresPerNewton);
      markers.showPull(isOwn ? target_m : null);
      if (state.seat === this.ghostSeat) this.showGhost(state, markers.person);
    }
  }

  showGhost(state, person) {
    const away_m = Math.hypot(...state.seen_m.map((place, axis) => place - this.body.position.getComponent(axis)));
    this.ghost.visible = state.state !== "free" && away_m > GHOST_AWAY * this.extent_m; // false for NaN
    this.ghost.position.set(...state.seen_m);
    this.ghost.quaternion.copy(this.body.quaternion);
    this.ghost.paint(person.colour);
  }

  draw() {
    for (const markers of this.people.values()) markers.contact.quaternion.copy(this.orbit.camera.quaternion);
    this.renderer.render(this.world, this.orbit.camera);
    this.labels.place(this);
  }

  /** @param {Vector3} point @returns {[number, number]} CSS pixels from the picture's upper left corner */
  project(point) {
    const { x, y } = point.clone().project(this.orbit.camera);
    return [((x + 1) / 2) * this.size.x, ((1 - y) / 2) * this.size.y];
  }

  /** @returns {object} world positions as they were drawn; those hidden are null */
  drawn() {
    const where = (node) => (node.visible ? new Vector3().setFromMatrixPosition(node.matrixWorld).toArray() : null);
    const people = [...this.people.values()].filter((each) => each.visible);
    return {
      object: this.bodies ? null : where(this.body),
      bodies: this.bodies?.drawn() ?? [],
      target: this.target && { place: this.target.position.toArray(), size: this.target.size_m },
      ghost: where(this.ghost),
      people: people.map((each) => ({ seat: each.person.seat, hand: where(each.device), proxy: where(each.proxy), force: each.force.visible, handle: each.handle.visible ? each.handle.quaternion.toArray() : null })),
    };
  }

  /** Draw without grid and axes, once. @param {string} background @returns {object} the picture as a data: URL, and its camera */
  portrait(background) {
    this.grid.visible = false;
    this.renderer.setClearColor(background);
    this.renderer.render(this.world, this.orbit.camera);
    const png = this.renderer.domElement.toDataURL();
    this.grid.visible = true;
    this.renderer.setClearColor(this.colours.background);
    this.changed();
    return { png, eye_m: this.orbit.camera.position.toArray(), target_m: this.orbit.target.toArray(), fov_deg: this.orbit.camera.fov };
  }

  /** @returns {{force_n: number, pixels: number}} a round force and the length of its arrow at the middle of the picture */
  arrowLegend() {
    const pixelsPerNewton = this.metresPerNewton / this.orbit.metresPerPixel();
    const force_n = roundDown(110 / pixelsPerNewton);
    return { force_n, pixels: force_n * pixelsPerNewton };
  }
}
