// SPDX-License-Identifier: Apache-2.0
// Inverse kinematics in closed form and by search, in WebAssembly. Lengths are in metres, angles in radians, joints in order
// from base to tip, poses 4 x 4 row by row, as arrays of 16 numbers. One thread: a call returns when it is done.

const WIDTH = 8; // [bytes] of a number in the tables of the kernels; truth values in arrays take one.

/** The kernels, and memory that they share with this side. */
class Machine {
  constructor(instance, description) {
    this.exports = instance.exports;
    this.description = description;
    this.table = this.exports.malloc(512 * WIDTH);
    const functions = this.exports.__indirect_function_table;
    this.addresses = {};
    for (const name of Object.keys(description.routines.places)) {
      this.addresses[name] = functions.grow(1);
      functions.set(this.addresses[name], this.exports[name]);
    }
  }

  /** Room for an array of floats ("f"), whole numbers ("i") or truth values ("b"); it stays where it is for good. */
  room(kind, shape) {
    const length = shape.reduce((all, each) => all * each, 1);
    const at = this.exports.malloc(Math.max(length, 1) * WIDTH + 64);
    if (!at) throw new Error("the kernels are out of memory");
    return { kind, shape, length, at: Math.ceil(at / 64) * 64 };
  }

  /** A view of an array; only good until the next call, for the memory may move. */
  view(array) {
    const kinds = { f: Float64Array, i: BigInt64Array, b: Uint8Array };
    return new kinds[array.kind](this.exports.memory.buffer, array.at, array.length);
  }

  /** An array that holds these numbers. */
  floats(values, shape = [values.length]) {
    const array = this.room("f", shape);
    this.view(array).set(values);
    return array;
  }

  /** An array as Python wrote it. */
  decoded({ kind, shape, data }) {
    const array = this.room(kind, shape);
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    new Uint8Array(this.exports.memory.buffer, array.at, bytes.length).set(bytes);
    return array;
  }

  /** Call a kernel; what it takes by name, see `entries` of the description. It gives back what the kernel returns. */
  call(name, given) {
    const { takes, returns } = this.description.entries[name];
    let floats = new Float64Array(this.exports.memory.buffer, this.table, 512);
    let words = new Int32Array(this.exports.memory.buffer, this.table, 1024);
    let slot = 0;
    const put = (whole) => {
      words[2 * slot] = whole;
      words[2 * slot + 1] = Math.floor(whole / 2 ** 32);
      slot++;
    };
    for (const [path, kind, dimensions] of takes) {
      const value = given[path];
      if (value === undefined) throw new TypeError(`${name} lacks ${path}`);
      if (dimensions === 0) {
        if (kind === "f") floats[slot++] = value;
        else put(Number(value));
        continue;
      }
      if (value.kind !== kind || value.shape.length !== dimensions) throw new TypeError(`${name}: ${path} does not fit`);
      put(value.at);
      for (const length of value.shape) put(length);
    }
    if (this.exports[name](this.table) !== 0) throw new Error(`${name} is out of memory`);
    floats = new Float64Array(this.exports.memory.buffer, this.table, 512);
    words = new Int32Array(this.exports.memory.buffer, this.table, 1024);
    return returns.map((kind) => {
      const at = slot++;
      if (kind === "f") return floats[at];
      const whole = words[2 * at + 1] * 2 ** 32 + (words[2 * at] >>> 0);
      return kind === "b" ? whole !== 0 : whole;
    });
  }
}

/** The kernels and all arms of a description; `wasm` are the bytes of kinseek.wasm, `description` is arms.json parsed. */
export async function load(wasm, description) {
  const { instance } = await WebAssembly.instantiate(wasm, {});
  const machine = new Machine(instance, description);
  return { names: description.arms.map((arm) => arm.name), arm: (name) => new Arm(machine, one(description, name)) };
}

function one(description, name) {
  const found = description.arms.find((arm) => arm.name === name);
  if (!found) throw new RangeError(`unknown arm '${name}'. Valid: ${description.arms.map((arm) => arm.name).join(", ")}`);
  return found;
}

/** Samples of the middle joints, row by row, as kinseek.robots.sampling spreads them. */
function spread({ steps, lower, upper }, count) {
  const values = new Float64Array(count * steps.length);
  for (let i = 0; i < count; i++) {
    for (let j = 0; j < steps.length; j++) {
      let centred = ((0.5 + (i + 1) * steps[j]) % 1.0) - 0.5;
      // Answers crowd in the corners of the limits: every eighth sample is spread twice as wide and brought back.
      if (i % 8 === 7) centred = Math.min(Math.max(2 * centred, -0.5), 0.5);
      values[i * steps.length + j] = lower[j] + (centred + 0.5) * (upper[j] - lower[j]);
    }
  }
  return values;
}

/** One arm. Making it samples it and sorts the samples, which takes some tens of milliseconds. */
class Arm {
  constructor(machine, data) {
    this.machine = machine;
    this.data = data;
    this.dof = data.lower.length;
    this.arrays = Object.fromEntries(Object.entries(data.arrays).map(([name, each]) => [name, machine.decoded(each)]));
    this.routines = machine.room("i", [Object.keys(machine.addresses).length + 2]);
    const places = machine.view(this.routines).fill(0n);
    for (const [name, place] of Object.entries(machine.description.routines.places)) {
      places[place] = BigInt(machine.addresses[name]);
    }
    this.fine = this.#atlas(data.samples.fine);
    this.coarse = data.samples.coarse === data.samples.fine ? this.fine : this.#atlas(data.samples.coarse);
    this.steps = machine.room("f", [data.freedom ? 0 : data.samples.coarse, 6, machine.description.lanes]);
    if (!data.freedom) machine.call("ks_fill_steps", { handle: this.coarse, steps: this.steps, w: machine.description.lanes });
    this.target = machine.room("f", [1, 4, 4]);
    this.q = machine.room("f", [this.dof]);
    this.near = machine.room("f", [this.dof]);
    this.eye = machine.room("f", [1, 3, this.dof]);
    this.counts = machine.room("i", [1]);
    this.results = null;
    this.proof = null;
  }

  /** Sort so many samples; the handle of a task that looks among them. */
  #atlas(count) {
    const { machine, data } = this;
    const { leaf, beside, rows, routines } = machine.description;
    const { head, columns } = data.division;
    const leaves = count / leaf;
    const middle = machine.floats(spread(data.samples, count), [count, data.samples.steps.length]);
    const made = {
      "atlas.tree.points": machine.room("f", [leaves, (head === 0 ? 3 : 2) + 3 * columns, leaf]),
      "atlas.tree.axis": machine.room("i", [Math.max(leaves - 1, 1)]),
      "atlas.tree.split": machine.room("f", [Math.max(leaves - 1, 1)]),
      "atlas.tree.beside": machine.room("i", [leaves, beside]),
      "atlas.middle": machine.room("f", middle.shape),
      "atlas.poses": machine.room("f", [count, 3, 4]),
    };
    machine.view(made["atlas.tree.beside"]).fill(-1n);
    const held = { ...this.arrays, ...made, routines: this.routines };
    const division = Object.fromEntries(Object.entries(data.division).map(([name, value]) => [`division.${name}`, value]));
    machine.call("ks_fill_atlas", { ...held, ...division, middle, first: data.samples.first });
    const handle = machine.room("i", [4 * rows.length]);
    const words = machine.view(handle);
    rows.forEach((name, row) => {
      const { at, shape } = held[name];
      [at, ...shape, 1, 1].slice(0, 4).forEach((each, i) => (words[4 * row + i] = BigInt(each)));
    });
    if (rows[routines.row] !== "routines") throw new Error("the module and the description are of different versions");
    return handle;
  }

  /** The pose of the tip at joint values. */
  fk(q) {
    this.#numbers(q, this.dof, "joint values");
    const { machine } = this;
    machine.view(this.q).set(q);
    const given = { ...this.arrays, q: { ...this.q, shape: [1, this.dof] }, poses: this.target };
    machine.call("ks_write_poses", given);
    return machine.view(this.target).slice();
  }

  /** How far the tip at joint values is from a pose. */
  errors(q, pose) {
    this.#numbers(pose, 16, "a pose");
    const tip = this.fk(q);
    const square = (places) => places.reduce((all, i) => all + (tip[i] - pose[i]) ** 2, 0);
    const chord = Math.sqrt(square([0, 1, 2, 4, 5, 6, 8, 9, 10]) / 8);
    return { positionError: Math.sqrt(square([3, 7, 11])), orientationError: 2 * Math.asin(Math.min(chord, 1)) };
  }

  /** Joint values that reach a pose, or the best found; with `near` the answer nearest to these joint values. */
  solve(pose, near = null) {
    this.#aim(pose);
    const { machine } = this;
    const given = { address: this.fine.at, target: { ...this.target, shape: [4, 4] }, q: this.q };
    let told;
    if (near === null) told = machine.call("ks_solve_plain", given);
    else {
      this.#numbers(near, this.dof, "near");
      machine.view(this.near).set(near);
      told = machine.call("ks_solve_goal", { ...given, tolerances: this.arrays.plain, near: this.near, close: true });
    }
    const [positionError, orientationError, weightedError, evaluations, reached] = told;
    if (evaluations < 0) throw new RangeError("the pose is no rigid transform");
    return { q: machine.view(this.q).slice(), reached, positionError, orientationError, weightedError, evaluations };
  }

  /** All solutions, or a well-spread sample of `count` of them for a redundant arm; nearest to `near` first, if given. */
  branches(pose, { near = null, count = 24 } = {}) {
    this.#aim(pose);
    const { machine, dof } = this;
    const { most, behind } = machine.description.branches;
    const number = this.data.freedom ? count : 0;
    const room = (number || most) + 1;
    if (this.results === null || this.results.shape[1] !== room) this.results = machine.room("f", [1, room, dof + behind]);
    const eye = machine.view(this.eye);
    eye.set(machine.view(this.arrays.view));
    if (near !== null) {
      this.#numbers(near, dof, "near");
      eye.set(near);
      eye.fill(1.0, dof, 2 * dof);
    }
    machine.call("ks_many_branches", {
      "arm.handle": this.coarse,
      "arm.fine": this.fine,
      "arm.mirrors": this.arrays.mirrors,
      "arm.structure": this.arrays.structure,
      "arm.joint": this.arrays.joint,
      "arm.table": this.arrays.table,
      "arm.steps": this.steps,
      tolerances: this.arrays.plain,
      targets: this.target,
      views: this.eye,
      number,
      results: this.results,
      counts: this.counts,
    });
    const rows = Number(machine.view(this.counts)[0]);
    if (rows === 0) throw new RangeError("the pose is no rigid transform");
    const all = machine.view(this.results);
    const width = dof + behind;
    const last = all.slice((rows - 1) * width, rows * width);
    const answers = [];
    for (let i = 0; i < last[0]; i++) {
      const row = all.slice(i * width, (i + 1) * width);
      answers.push({ q: row.slice(0, dof), positionError: row[dof], orientationError: row[dof + 1] });
    }
    return { answers, evaluations: last[1], endless: this.data.freedom > 0 || last[2] > 0 };
  }

  /** Begin a proof that a pose is out of reach; call `goOn` of it until it is no longer "more". */
  prove(pose) {
    this.#aim(pose);
    return new Proof(this, pose);
  }

  #aim(pose) {
    this.#numbers(pose, 16, "a pose");
    this.machine.view(this.target).set(pose);
  }

  #numbers(values, length, what) {
    if (values.length !== length) throw new RangeError(`${what}: expected ${length} numbers, got ${values.length}`);
    if (!values.every(Number.isFinite)) throw new RangeError(`${what}: a number is not finite`);
  }
}

/** A search through boxes of joint values, in parts; a new one of the same arm ends it. */
class Proof {
  constructor(arm, pose) {
    const { machine, data } = arm;
    const { count } = machine.description.proof;
    this.arm = arm;
    arm.proof ??= {
      given: Object.fromEntries(
        Object.entries(data.proof.given).map(([name, each]) => [name, each?.data === undefined ? each : machine.decoded(each)]),
      ),
      memory: Object.fromEntries(
        Object.entries(data.proof.memory).map(([name, { kind, shape }]) => [name, machine.room(kind, shape)]),
      ),
      start: machine.decoded(data.proof.boxes),
    };
    const held = arm.proof;
    machine.view(held.given["question.goal.target"]).set(pose.slice(0, 12));
    const target = product(product(data.proof.left.flat(), pose), data.proof.right.flat());
    machine.view(held.given["question.proof_goal.target"]).set(target);
    const far = Math.hypot(target[3], target[7], target[11]);
    held.given["question.proof_goal.margin"] = held.given["question.proof_goal.margin_a"] * (data.proof.reach + far);
    this.#memory("boxes").set(machine.view(held.start));
    this.#memory("q").fill(0.0);
    this.#memory("counts").fill(0n)[count] = 1n;
    this.#memory("figures").set([Infinity, Infinity, 0.0, Infinity]);
    this.seen = 0;
  }

  /** Look at so many boxes more: "unreachable" is proved, "reached" comes with `q`; "undecided" or "more". */
  goOn(boxes) {
    const { arm } = this;
    const { machine } = arm;
    const { outcomes, count, seen, stuck } = machine.description.proof;
    const held = arm.proof;
    this.seen += boxes;
    const [outcome] = machine.call("ks_search_boxes", { ...held.given, ...held.memory, until: this.seen, budget: 2 ** 31 });
    const counts = this.#memory("counts");
    this.boxes = Number(counts[seen]);
    if (outcome === outcomes.found) {
      this.q = this.#memory("q").slice();
      return "reached";
    }
    if (outcome === outcomes.full) return "undecided";
    if (outcome !== outcomes.ended) return "more";
    return counts[count] === 0n && this.#memory("figures")[stuck] === 0.0 ? "unreachable" : "undecided";
  }

  #memory(name) {
    const { machine, proof } = this.arm;
    return machine.view(proof.memory[`memory.${name}`]);
  }
}

/** The product of two rigid transforms, row by row; of each only the first twelve numbers are read, and twelve come back. */
export function product(a, b) {
  const out = new Float64Array(12);
  for (let r = 0; r < 3; r++) {
    for (let c = 0; c < 4; c++) {
      out[4 * r + c] = a[4 * r] * b[c] + a[4 * r + 1] * b[4 + c] + a[4 * r + 2] * b[8 + c] + (c === 3 ? a[4 * r + 3] : 0);
    }
  }
  return out;
}
