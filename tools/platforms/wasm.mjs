// Prints the checksums of files, as the program does, from the WebAssembly module: node wasm.mjs MODULE FILE...
import { readFileSync } from "node:fs";
import { basename } from "node:path";

const [module, ...files] = process.argv.slice(2);
const { instance } = await WebAssembly.instantiate(readFileSync(module), {});
const { memory, file, decode, text } = instance.exports;
for (const path of files) {
    const bytes = readFileSync(path);
    // Asked for first: it may make the memory grow, and its buffer another one.
    const at = file(bytes.length);
    new Uint8Array(memory.buffer, at, bytes.length).set(bytes);
    const length = decode();
    const said = new TextDecoder().decode(new Uint8Array(memory.buffer, text(), length).slice());
    process.stdout.write(`# ${basename(path)}\n${said}`);
}
