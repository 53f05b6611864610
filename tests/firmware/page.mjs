// Runs a WebAssembly image in Node: node page.mjs IMAGE.wasm
// The image may want nothing but a function that prints; a reachable panic would be another import.
import { readFileSync, writeSync } from "node:fs";

const module = new WebAssembly.Module(readFileSync(process.argv[2]));
const imports = WebAssembly.Module.imports(module).map(({ module, name }) => `${module}.${name}`);
if (imports.join() !== "host.print_bytes") {
  console.error(`the image wants ${imports.join(", ") || "nothing"}, expected host.print_bytes only`);
  process.exit(2);
}
const print_bytes = (text, len) => writeSync(1, new Uint8Array(instance.exports.memory.buffer, text, len));
const instance = new WebAssembly.Instance(module, { host: { print_bytes } });
process.exit(instance.exports.run());
