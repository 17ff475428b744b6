// The page: what is dragged is solved in the next frame, and everything that the search says is shown.
import description from "../build/arms.json";
import about from "../build/about.json";
import { load } from "../build/kinseek.js";
import wasm from "../build/kinseek.wasm";

import { Panel } from "./panel.js";
import { Stage } from "./stage.js";

const HOME = {
  ur5e: [-0.4, -1.9, 1.9, -1.57, -1.57, 0],
  panda: [0.2, -0.5, 0, -2.1, 0, 1.6, 0.8],
  kr6r900: [-0.3, -1.3, 1.7, 0.3, 0.9, 0],
  iiwa14: [0.2, 0.5, 0, -1.5, 0, 1.1, 0],
  puma560: [0.2, 0.7, 0.1, 0.3, 0.8, 0],
  scara4: [0.5, 1.3, 0.08, 0.6],
};
const GHOSTS = 9; // Of a redundant arm, which has infinitely many solutions.
const GLIDE = 350; // [ms] from one answer to another that is chosen.
const SOON = 250; // [ms] between two measurements of the time that an answer takes.
const BOXES = 400; // That a proof looks at before it asks how late it is.
const SLICE = 5; // [ms] of a frame that a proof may take.

const still = matchMedia("(prefers-reduced-motion: reduce)");
let stage;
const panel = new Panel(about, {
  arm: (name) => page.take(name),
  answer: (k) => page.choose(k),
  pose: (pose) => page.aimAt(pose),
  mode: (mode) => (stage.mode = mode),
  home: () => page.home(),
});

const page = {
  arms: {},
  state: null, // What was found for the target, last.
  asked: false, // Has the target moved since?

  /** The target as a pose, 16 numbers. */
  get target() {
    return stage.pose;
  },

  /** Where the target is on the screen, [px]. */
  onScreen() {
    return stage.onScreen();
  },

  async begin() {
    stage = new Stage(document.getElementById("view"), () => this.aim());
    this.kernels = await load(wasm, description);
    this.take(this.kernels.names[0]);
    requestAnimationFrame((now) => this.frame(now));
  },

  take(name) {
    this.arm = this.arms[name] ??= this.kernels.arm(name);
    this.proof = null;
    stage.take(this.arm);
    panel.take(this.arm);
    this.home();
  },

  home() {
    this.q = Float64Array.from(HOME[this.arm.data.name]);
    this.glide = null;
    this.measured = -Infinity;
    stage.pose = this.arm.fk(this.q);
    stage.face();
    this.aim();
  },

  aim() {
    this.asked = true;
  },

  aimAt(pose) {
    stage.pose = pose;
    this.aim();
  },

  /** Search for the target: of all answers the one nearest to where the arm stands is shown, the others are ghosts. */
  solve(known = null) {
    const { arm } = this;
    const pose = stage.pose;
    const began = performance.now();
    let best = known === null ? arm.solve(pose, this.q) : { q: known, reached: true, ...arm.errors(known, pose) };
    const { reached } = best;
    const { answers, endless } = reached ? arm.branches(pose, { near: this.q, count: GHOSTS }) : { answers: [], endless: false };
    // Of infinitely many the nearest is hardly among those that are shown; of a few it is the first.
    if (reached && (endless || !answers.length)) answers.unshift(best);
    else if (reached) best = answers[0];
    // Sorted as the joints are, so that a button stays the same answer while the target is dragged.
    const others = answers.map((one) => one.q).sort(order);
    this.spent = performance.now() - began;
    this.glide = null;
    this.times = [Infinity, Infinity];
    this.measurements = 0;
    this.q = best.q;
    this.proof = reached ? null : arm.prove(pose);
    this.state = { reached, best, others, chosen: others.indexOf(best.q), endless, proof: reached ? null : "more" };
    this.show();
  },

  show() {
    const { reached, others, chosen } = this.state;
    stage.show(this.q, others.filter((_, k) => k !== chosen), !reached);
    panel.show(this.state, this.q, stage.pose);
  },

  /** Look at more boxes until the proof ends, or this frame's time. */
  goOn(now) {
    let told = "more";
    while (told === "more" && performance.now() - now < SLICE) told = this.proof.goOn(BOXES);
    if (told === "more" && this.proof.boxes < 3e6) return;
    if (told === "reached") {
      this.solve(this.proof.q); // The search had overlooked it.
      return;
    }
    this.state.proof = told === "more" ? "undecided" : told;
    this.state.boxes = this.proof.boxes;
    this.proof = null;
    this.show();
  },

  choose(k) {
    const to = this.state.others[k];
    this.state.chosen = k;
    this.glide = still.matches ? null : { from: this.q, to, began: performance.now() };
    if (still.matches) this.q = to;
    this.show();
  },

  /** How long an answer takes, [µs]: the least of three stretches, each long enough for the clock to tell. */
  measure(now) {
    const pose = stage.pose;
    const least = (one) => {
      let best = Infinity;
      for (let stretch = 0; stretch < 3 && !(best > 2000 && stretch > 0); stretch++) {
        const began = performance.now();
        let runs = 0;
        for (; performance.now() - began < 0.8; runs++) one();
        best = Math.min(best, (1e3 * (performance.now() - began)) / runs);
      }
      return best;
    };
    const searches = [() => this.arm.solve(pose)];
    if (this.state.reached) searches.push(() => this.arm.branches(pose, { near: this.q, count: GHOSTS }));
    this.times = searches.map((one, i) => Math.min(this.times[i], least(one)));
    panel.times(...this.times);
    this.measured = now;
    this.measurements++;
  },

  frame(now) {
    const began = performance.now();
    if (this.asked) {
      this.asked = false;
      this.solve();
    } else if (this.glide) {
      const share = Math.min((now - this.glide.began) / GLIDE, 1);
      const part = share * share * (3 - 2 * share);
      const { from, to } = this.glide;
      this.q = to.map((value, i) => (share < 1 ? from[i] + part * (value - from[i]) : value));
      if (share === 1) this.glide = null;
      this.show();
    } else if (this.proof) this.goOn(began);
    // Once more when the target rests, for the clock of a busy machine tells too much.
    if (now - this.measured > SOON && this.measurements < (this.state.reached ? 4 : 1)) this.measure(now);
    stage.draw();
    requestAnimationFrame((next) => this.frame(next));
  },
};

function order(a, b) {
  for (let i = 0; i < a.length; i++) {
    if (Math.abs(a[i] - b[i]) > 0.05) return a[i] - b[i];
  }
  return 0;
}

window.kinseekPage = page; // For tests, and for whoever is curious.
page.begin().catch((error) => panel.fail(`This page needs WebGL 2 and WebAssembly with SIMD: ${error.message}`));
