// Bundle the page into one file, dist/index.html. The kernels and arms come from build/, see build.py.
import { readFile, mkdir, writeFile } from "node:fs/promises";
import { build } from "esbuild";

const read = (path) => readFile(new URL(path, import.meta.url), "utf8");

const { outputFiles } = await build({
  entryPoints: [new URL("src/main.js", import.meta.url).pathname],
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  loader: { ".wasm": "binary" },
  legalComments: "none", // The licence of three.js is written out in full below.
  write: false,
});
const [page, style, three, about] = await Promise.all(
  ["src/index.html", "src/style.css", "node_modules/three/LICENSE", "build/about.json"].map(read),
);
const arms = Object.entries(JSON.parse(about)).map(([name, { source, licence }]) => `  ${name}: ${source}; ${licence}`);
const notice = [
  "kinseek and this page: Apache License 2.0, https://www.apache.org/licenses/LICENSE-2.0",
  "Axes and limits of the arms, each from:",
  ...arms,
  "three.js:",
  three.trim(),
].join("\n");
const parts = {
  "/* style */": style,
  "/* script */": outputFiles[0].text.replaceAll("</script", "<\\/script"),
  "notice": notice.replaceAll("--", "- -"),
};
const whole = page.replace(/\/\* (?:style|script) \*\/|(?<=<!--\n)notice(?=\n-->)/g, (mark) => parts[mark]);
await mkdir(new URL("dist", import.meta.url), { recursive: true });
await writeFile(new URL("dist/index.html", import.meta.url), whole);
console.log(`dist/index.html: ${(Buffer.byteLength(whole) / 1e6).toFixed(2)} MB`);
