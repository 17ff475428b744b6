// The 3D view: floor, light, the arm, its other answers as ghosts, and the target that is dragged.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { TransformControls } from "three/addons/controls/TransformControls.js";

import { Chain, Copies, toMatrix } from "./drawing.js";

const MOST_GHOSTS = 64;
const AXES = [0xc0504d, 0x4f9a53, 0x3f7cc4]; // x, y, z

export class Stage {
  constructor(canvas, moved) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.02, 50);
    this.camera.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.maxPolarAngle = 0.62 * Math.PI;
    this.orbit.listenToKeyEvents(canvas);
    this.orbit.addEventListener("change", () => this.redraw());
    this.target = new THREE.Group();
    this.scene.add(this.target);
    this.gizmo = new TransformControls(this.camera, canvas);
    this.gizmo.setSize(matchMedia("(pointer: coarse)").matches ? 1.15 : 0.85);
    this.gizmo.setColors(...AXES, 0xe0a83a);
    this.gizmo.attach(this.target);
    this.gizmo.addEventListener("dragging-changed", ({ value }) => (this.orbit.enabled = !value));
    this.gizmo.addEventListener("objectChange", moved);
    this.gizmo.addEventListener("change", () => this.redraw());
    this.scene.add(this.gizmo.getHelper());
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f8c, 1.9));
    const sun = new THREE.DirectionalLight(0xffffff, 1.7);
    sun.position.set(2, -1.5, 4);
    this.scene.add(sun);
    this.body = new THREE.MeshStandardMaterial({ roughness: 0.55, metalness: 0.05 });
    this.joint = new THREE.MeshStandardMaterial({ roughness: 0.6, metalness: 0.1 });
    this.ghost = new THREE.MeshStandardMaterial({ transparent: true, opacity: 0.24, depthWrite: false, roughness: 0.9 });
    // Where a ghost lies on the arm the arm is seen.
    Object.assign(this.ghost, { polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 16 });
    this.floorLines = new THREE.LineBasicMaterial({ transparent: true });
    this.gap = new THREE.Line(
      new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3()]),
      new THREE.LineDashedMaterial({ depthTest: false }),
    );
    this.gap.frustumCulled = false;
    this.gap.visible = false;
    this.scene.add(this.gap);
    this.dirty = true;
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.dress());
    this.dress();
    this.resize();
  }

  /** Take the colours of the style sheet. */
  dress() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    this.colours = { body: colour("--body"), miss: colour("--miss") };
    this.joint.color.set(colour("--joint"));
    this.ghost.color.set(colour("--ghost"));
    this.floorLines.color.set(colour("--floor"));
    this.gap.material.color.set(colour("--miss"));
    this.body.color.set(this.missed ? this.colours.miss : this.colours.body);
    this.redraw();
  }

  /** What dragging does: "translate" along the axes of the base, or "rotate" about those of the target. */
  set mode(mode) {
    this.gizmo.setMode(mode);
    this.gizmo.setSpace(mode === "translate" ? "world" : "local");
  }

  /** Show another arm, seen from where all of its reach is in view. */
  take(arm) {
    for (const old of [this.arm, this.ghosts, this.floor, this.mark].filter(Boolean)) {
      old.removeFromParent();
      old.dispose?.();
    }
    const chain = new Chain(arm);
    this.chain = chain;
    this.arm = new Copies(chain, { body: this.body, joint: this.joint });
    this.ghosts = new Copies(chain, { most: MOST_GHOSTS, body: this.ghost, joint: this.ghost, ghosts: true });
    this.floor = floor(chain.size, this.floorLines);
    this.mark = mark(0.11 * chain.size);
    this.scene.add(this.arm, this.ghosts, this.floor);
    this.target.add(this.mark);
    this.gap.material.dashSize = 0.02 * chain.size;
    this.gap.material.gapSize = 0.014 * chain.size;
    this.orbit.target.set(0.12 * chain.size, 0, 0.38 * chain.size);
    this.look = new THREE.Vector3(1.35, -2.05, 1.2).multiplyScalar(0.86 * chain.size);
    this.orbit.minDistance = 0.4 * chain.size;
    this.orbit.maxDistance = 8 * chain.size;
    this.resize();
    this.face();
  }

  /** Look from the front, from farther off where the view is narrow. */
  face() {
    if (!this.look) return;
    const away = Math.max(1, 1.2 / this.camera.aspect);
    this.camera.position.copy(this.look).multiplyScalar(away).add(this.orbit.target);
    this.orbit.update();
    this.redraw();
  }

  /** The arm at joint values, ghosts at others; a line to the target where it is missed. */
  show(q, ghosts, missed) {
    this.arm.show([q]);
    this.ghosts.show(ghosts.slice(0, MOST_GHOSTS));
    this.missed = missed;
    this.body.color.set(missed ? this.colours.miss : this.colours.body);
    const tip = this.chain.frames(q).at(-1);
    const { position } = this.gap.geometry.attributes;
    position.setXYZ(0, tip[3], tip[7], tip[11]);
    position.setXYZ(1, ...this.target.position);
    position.needsUpdate = true;
    this.gap.computeLineDistances();
    this.gap.visible = missed;
    this.redraw();
  }

  /** The target as a pose, 16 numbers row by row. */
  get pose() {
    this.target.updateMatrix();
    return this.target.matrix.clone().transpose().toArray();
  }

  set pose(pose) {
    toMatrix(Array.from(pose).slice(0, 12)).decompose(this.target.position, this.target.quaternion, this.target.scale);
    this.target.scale.set(1, 1, 1);
    this.redraw();
  }

  /** Where the target is on the screen, [px]. */
  onScreen() {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const at = this.target.position.clone().project(this.camera);
    return [left + (0.5 + 0.5 * at.x) * width, top + (0.5 - 0.5 * at.y) * height];
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  redraw() {
    this.dirty = true;
  }

  /** Draw, if anything has changed. */
  draw() {
    if (!this.dirty) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    return true;
  }
}

/** Rings and two lines, a tenth of the reach apart. */
function floor(size, material) {
  const points = [];
  const rings = 5;
  for (let k = 1; k <= rings; k++) {
    const radius = (k / rings) * 1.1 * size;
    for (let i = 0; i < 96; i++) {
      for (const at of [i, i + 1]) {
        const angle = (at / 96) * 2 * Math.PI;
        points.push(new THREE.Vector3(radius * Math.cos(angle), radius * Math.sin(angle), 0));
      }
    }
  }
  const far = 1.1 * size;
  for (const [x, y] of [[1, 0], [0, 1]]) {
    points.push(new THREE.Vector3(-far * x, -far * y, 0), new THREE.Vector3(far * x, far * y, 0));
  }
  return new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), material);
}

/** The target: three thin axes, red, green and blue. */
function mark(size) {
  const group = new THREE.Group();
  AXES.forEach((colour, i) => {
    const bar = new THREE.CylinderGeometry(0.022 * size, 0.022 * size, size, 12).translate(0, size / 2, 0);
    const mesh = new THREE.Mesh(bar, new THREE.MeshBasicMaterial({ color: colour }));
    if (i === 0) mesh.rotation.z = -Math.PI / 2;
    if (i === 2) mesh.rotation.x = Math.PI / 2;
    group.add(mesh);
  });
  return group;
}
