// node javascript.mjs FOLDER ASKED.json: what the kernels of a folder that `to_wasm` wrote answer to goals, as JSON.
import { readFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [folder, asked] = process.argv.slice(2);
const { load } = await import(pathToFileURL(`${folder}/kinseek.js`));
const description = JSON.parse(await readFile(`${folder}/arms.json`, "utf8"));
const { arm } = await load(await readFile(`${folder}/kinseek.wasm`), description);

/** Look at boxes until a proof ends. */
function proved(one, pose) {
  const proof = one.prove(pose);
  for (let turns = 0; turns < 60; turns++) {
    const told = proof.goOn(1000);
    if (told !== "more") return { told, boxes: proof.boxes, q: proof.q ? Array.from(proof.q) : null };
  }
  return { told: "more", boxes: proof.boxes, q: null };
}

const plain = (key, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
const answers = {};
for (const [name, { q, poses, far }] of Object.entries(JSON.parse(await readFile(asked, "utf8")))) {
  const began = performance.now();
  const one = arm(name);
  const built = performance.now() - began;
  const run = (make) => {
    const start = performance.now();
    const made = poses.map(make);
    return { made, each: (1e3 * (performance.now() - start)) / poses.length };
  };
  poses.slice(0, 20).forEach((pose) => one.solve(pose) && one.branches(pose));
  const solved = run((pose) => one.solve(pose));
  const near = run((pose, i) => one.solve(pose, q[i]));
  const all = run((pose) => one.branches(pose));
  const refused = [poses[0].map(() => NaN), poses[0].map((x) => 2 * x), [1, 2]].map((bad) => {
    try {
      one.solve(bad);
      return "";
    } catch (error) {
      return error.message;
    }
  });
  answers[name] = {
    fk: q.map((each) => one.fk(each)),
    errors: poses.map((pose, i) => one.errors(q[(i + 1) % q.length], pose)),
    solved: solved.made,
    near: near.made,
    branches: all.made,
    far: far.map((pose) => ({ ...one.solve(pose), ...{ proof: proved(one, pose), all: one.branches(pose).answers.length } })),
    refused,
    built,
    times: [solved.each, near.each, all.each],
  };
}
console.log(JSON.stringify(answers, plain));
