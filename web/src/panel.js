// Everything beside the picture: choices, what the search says, joints, and the target as numbers.

const DEGREE = Math.PI / 180;
const $ = (id) => document.getElementById(id);
const made = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** So many digits that count, without an exponent, and no sign on nothing. */
const digits = (value, count) => Number(value.toPrecision(count)).toLocaleString("en", { maximumFractionDigits: 6 });
const fixed = (value, places) => (Number(value.toFixed(places)) + 0).toFixed(places);

/** A length in the unit that leaves few digits. */
function length(metres) {
  if (metres < 1e-8) return "<0.01 µm";
  if (metres < 1e-4) return `${digits(1e6 * metres, 2)} µm`;
  return metres < 1 ? `${digits(1e3 * metres, 3)} mm` : `${fixed(metres, 2)} m`;
}
const angle = (radians) => (radians / DEGREE < 1e-4 ? "<0.0001°" : `${digits(radians / DEGREE, 2)}°`);
const joint = (kind, value) => (kind === "prismatic" ? `${fixed(1e3 * value, 0)} mm` : `${fixed(value / DEGREE, 1)}°`);

/** How far off the best is, as words. */
function away({ positionError, orientationError }) {
  if (positionError < 1e-6) return `turned by ${angle(orientationError)}`;
  if (orientationError < 1e-5) return `${length(positionError)} away`;
  return `${length(positionError)} away and turned by ${angle(orientationError)}`;
}
const limit = (kind, value) => (kind === "prismatic" ? (1e3 * value).toFixed(0) : `${(value / DEGREE).toFixed(0)}°`);

const FIELDS = [
  ["x", "x, mm"], ["y", "y, mm"], ["z", "z, mm"],
  ["roll", "roll, °"], ["pitch", "pitch, °"], ["yaw", "yaw, °"],
];

export class Panel {
  constructor(about, events) {
    this.events = events;
    for (const [name, { title }] of Object.entries(about)) $("arm").append(made("option", { value: name, textContent: title }));
    $("arm").addEventListener("change", ({ target }) => events.arm(target.value));
    $("home").addEventListener("click", () => events.home());
    for (const [id, mode] of [["move", "translate"], ["turn", "rotate"]]) {
      $(id).addEventListener("click", () => {
        $("move").ariaPressed = String(id === "move");
        $("turn").ariaPressed = String(id === "turn");
        events.mode(mode);
      });
    }
    this.fields = FIELDS.map(([name, label]) => {
      const input = made("input", { type: "number", step: "any", id: `target-${name}`, required: true });
      input.addEventListener("input", () => this.#typed());
      $("target").append(made("label", {}, label, input));
      return input;
    });
    $("view").addEventListener("pointerup", () => ($("hint").dataset.seen = ""));
  }

  /** Show the joints of another arm. */
  take(arm) {
    const { lower, upper, kinds, joint_names: names } = arm.data;
    this.kinds = kinds;
    this.ranges = lower.map((low, i) => [low, upper[i]]);
    this.bars = lower.map((low, i) => {
      const knob = made("i");
      const value = made("span", { className: "value" });
      const bar = made("div", { className: "bar" }, made("b"), knob);
      const ends = [limit(kinds[i], low), limit(kinds[i], upper[i])];
      const row = made("li", { title: names[i] }, made("span", { className: "low", textContent: ends[0] }), bar, made("span", { textContent: ends[1] }), value);
      return { row, knob, value };
    });
    $("joints").replaceChildren(...this.bars.map(({ row }) => row));
    this.buttons = [];
  }

  /** Say what was found. */
  show(state, q, pose) {
    const { reached, best, others, chosen, endless } = state;
    $("status").dataset.state = reached ? "reached" : "missed";
    const said = reached ? this.#found(others.length, endless) : this.#missed(state);
    if ($("sentence").textContent !== said) $("sentence").textContent = said;
    $("position").textContent = length(best.positionError);
    $("orientation").textContent = angle(best.orientationError);
    this.#answers(reached ? others.length : 0, chosen);
    q.forEach((value, i) => {
      const [low, high] = this.ranges[i];
      const { row, knob, value: text } = this.bars[i];
      knob.style.left = `${(100 * (value - low)) / (high - low)}%`;
      text.textContent = joint(this.kinds[i], value);
      row.toggleAttribute("data-edge", Math.min(value - low, high - value) < 0.02 * (high - low));
    });
    if (!this.fields.includes(document.activeElement)) {
      numbers(pose).forEach((value, i) => (this.fields[i].value = fixed(value, 1)));
    }
  }

  #found(count, endless) {
    if (endless) return `Reached. There are infinitely many solutions inside the limits; ${count} of them are shown.`;
    return `Reached. ${count === 1 ? "One solution was" : `${count} solutions were`} found inside the limits.`;
  }

  #missed({ best, proof, boxes }) {
    const far = `nearest pose found is ${away(best)}`;
    if (proof === "more") return `Out of reach, it seems: the ${far}.`;
    if (proof === "undecided") return `Not reached, and not decided by a proof: the ${far}.`;
    return `Out of reach, proved${boxes > 0 ? ` by ${boxes.toLocaleString("en")} boxes of joint values` : ""}: the ${far}.`;
  }

  #answers(count, chosen) {
    if (this.buttons.length !== count || count === 0) {
      this.buttons = Array.from({ length: count }, (_, k) => {
        const button = made("button", { type: "button", textContent: String(k + 1), ariaLabel: `Answer ${k + 1} of ${count}` });
        button.addEventListener("click", () => this.events.answer(k));
        return button;
      });
      $("answers").replaceChildren(...(count ? this.buttons : ["None: the arm stands at the nearest pose found."]));
    }
    this.buttons.forEach((button, k) => (button.ariaPressed = String(k === chosen)));
  }

  /** Tell how long one answer and all answers take, [µs]. */
  times(one, all = null) {
    const told = (time) => (time < 1000 ? `${digits(time, 2)} µs` : `${digits(time / 1000, 2)} ms`);
    $("time").textContent = told(one);
    $("time-all").textContent = all === null ? "–" : told(all);
  }

  /** Say that nothing works. */
  fail(words) {
    $("status").dataset.state = "missed";
    $("sentence").textContent = words;
  }

  #typed() {
    if (this.fields.every((each) => each.validity.valid)) this.events.pose(poseOf(this.fields.map((each) => each.valueAsNumber)));
  }
}

/** Position [mm] and roll, pitch, yaw [°] of a pose: turns about the fixed axes x, y, z in this order. */
function numbers(pose) {
  const pitch = Math.atan2(-pose[8], Math.hypot(pose[0], pose[4]));
  const upright = Math.abs(Math.cos(pitch)) < 1e-9;
  const roll = upright ? 0 : Math.atan2(pose[9], pose[10]);
  const yaw = upright ? Math.atan2(-pose[1], pose[5]) : Math.atan2(pose[4], pose[0]);
  return [1e3 * pose[3], 1e3 * pose[7], 1e3 * pose[11], roll / DEGREE, pitch / DEGREE, yaw / DEGREE];
}

function poseOf([x, y, z, ...angles]) {
  const [[cr, sr], [cp, sp], [cy, sy]] = angles.map((each) => [Math.cos(each * DEGREE), Math.sin(each * DEGREE)]);
  return [
    cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x / 1e3,
    sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y / 1e3,
    -sp, cp * sr, cp * cr, z / 1e3,
    0, 0, 0, 1,
  ];
}
