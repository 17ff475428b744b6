// An arm as three.js draws it: capsules along the links, a drum at each joint. Only the chain is known, no meshes.
import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

import { product } from "../build/kinseek.js";

/** The fixed transforms and joints of a chain, for drawing. */
export class Chain {
  constructor(arm) {
    const numbers = (name) => Array.from(arm.machine.view(arm.arrays[`chain.${name}`]), Number);
    const fixed = numbers("fixed");
    this.prismatic = numbers("prismatic");
    this.leader = numbers("leader");
    this.multiplier = numbers("multiplier");
    this.offset = numbers("offset");
    this.fixed = [];
    for (let k = 0; k < fixed.length; k += 12) this.fixed.push(fixed.slice(k, k + 12));
    this.size = this.fixed.reduce((all, one, k) => all + (k === 0 ? 0 : Math.hypot(one[3], one[7], one[11])), 0);
    arm.data.upper.forEach((upper, i) => (this.size += this.prismatic[i] ? upper / 2 : 0));
  }

  /** Poses of base, every moved joint frame, and tip, twelve numbers each. */
  frames(q) {
    let pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
    const all = [pose];
    this.fixed.forEach((fixed, k) => {
      pose = product(pose, fixed);
      if (k < this.leader.length) {
        const value = this.multiplier[k] * q[this.leader[k]] + this.offset[k];
        const [c, s] = this.prismatic[k] ? [1, 0] : [Math.cos(value), Math.sin(value)];
        pose = product(pose, [c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, this.prismatic[k] ? value : 0]);
      }
      all.push(pose);
    });
    return all;
  }

  radius(k) {
    return this.size * (0.042 - (0.02 * k) / this.fixed.length);
  }
}

function between(from, to, radius) {
  const way = new THREE.Vector3().subVectors(to, from);
  const length = way.length();
  const part = new THREE.CapsuleGeometry(radius, length, 6, 20);
  part.applyQuaternion(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize()));
  return part.translate(...new THREE.Vector3().addVectors(from, to).multiplyScalar(0.5).toArray());
}

/** What each frame carries: the way to the next joint, first along this joint's axis, then across. */
function bodies(chain) {
  return chain.fixed.map((fixed, k) => {
    const to = new THREE.Vector3(fixed[3], fixed[7], fixed[11]);
    const corner = new THREE.Vector3(0, 0, to.z);
    const radius = chain.radius(k);
    const parts = [];
    const nothing = 1e-3 * chain.size;
    if (corner.length() > nothing) parts.push(between(new THREE.Vector3(), corner, radius));
    if (corner.distanceTo(to) > nothing) parts.push(between(corner, to, radius));
    return parts.length ? mergeGeometries(parts) : null;
  });
}

function drums(chain) {
  return chain.prismatic.map((slides, k) => {
    const radius = 1.3 * chain.radius(k);
    if (slides) return new THREE.BoxGeometry(1.5 * radius, 1.5 * radius, 2.6 * radius);
    const profile = [[0, -1.15], [0.86, -1.15], [1, -1.0], [1, 1.0], [0.86, 1.15], [0, 1.15]];
    const points = profile.map(([r, z]) => new THREE.Vector2(r * radius, z * radius));
    return new THREE.LatheGeometry(points, 32).rotateX(Math.PI / 2);
  });
}

function hand(chain) {
  const radius = 0.8 * chain.radius(chain.fixed.length);
  const plate = new THREE.CylinderGeometry(1.2 * radius, 1.2 * radius, 0.5 * radius, 32).rotateX(Math.PI / 2);
  const tip = new THREE.ConeGeometry(0.6 * radius, 1.2 * radius, 24).rotateX(-Math.PI / 2);
  return mergeGeometries([plate.translate(0, 0, -0.25 * radius), tip.rotateX(Math.PI).translate(0, 0, 0.6 * radius)]);
}

const depth = new THREE.MeshBasicMaterial({ colorWrite: false, polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 16 });

/** The same in depth alone, drawn first: of ghosts that lie behind each other only the foremost is seen, and the arm before all. */
function shade(mesh) {
  const same = new THREE.InstancedMesh(mesh.geometry, depth, mesh.instanceMatrix.count);
  same.instanceMatrix = mesh.instanceMatrix;
  same.renderOrder = 1;
  mesh.renderOrder = 2;
  return same;
}

const matrix = new THREE.Matrix4();

/** A matrix of three.js from twelve numbers. */
export function toMatrix(pose) {
  return matrix.set(...pose, 0, 0, 0, 1);
}

/** Copies of an arm, each part of all of them drawn in one call: in one material for its links and one for its joints. */
export class Copies extends THREE.Group {
  constructor(chain, { most = 1, body, joint, ghosts = false }) {
    super();
    this.chain = chain;
    this.parts = [];
    const add = (geometry, frame, material) => {
      if (geometry === null || (ghosts && frame === 0)) return; // The base is the same for all.
      const mesh = new THREE.InstancedMesh(geometry, material, most);
      const shades = ghosts ? [mesh, shade(mesh)] : [mesh];
      this.parts.push({ shades, frame });
      for (const each of shades) {
        each.frustumCulled = false; // Its parts are anywhere.
        each.count = 0;
        this.add(each);
      }
    };
    bodies(chain).forEach((geometry, k) => add(geometry, k, body));
    drums(chain).forEach((geometry, k) => add(geometry, k + 1, joint));
    add(hand(chain), chain.fixed.length, joint);
  }

  /** Show the arm at each of these joint values. */
  show(all) {
    const frames = all.map((q) => this.chain.frames(q));
    for (const { shades, frame } of this.parts) {
      const [mesh] = shades;
      frames.forEach((each, i) => mesh.setMatrixAt(i, toMatrix(each[frame])));
      mesh.instanceMatrix.needsUpdate = true;
      for (const each of shades) each.count = frames.length;
    }
  }

  dispose() {
    for (const { shades } of this.parts) {
      shades[0].geometry.dispose();
      for (const each of shades) each.dispose();
    }
  }
}
