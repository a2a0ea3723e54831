// Prints the checksums of files, as the program does, from the WebAssembly module: node wasm.mjs MODULE FILE...
import { readFileSync } from "node:fs";
import { basename } from "node:path";

const [module, ...files] = process.argv.slice(2);
const { instance } = await WebAssembly.instantiate(readFileSync(module), {});
const { memory, file, decode, text } = instance.exports;
for (const path of files) {
    const bytes = readFileSync(path);
    new Uint8Array(memory.buffer, file(bytes.length), bytes.length).set(bytes);
    const length = decode();
    const said = new TextDecoder().decode(new Uint8Array(memory.buffer, text(), length).slice());
    process.stdout.write(`# ${basename(path)}\n${said}`);
}
