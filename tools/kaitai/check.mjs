// Compiles spec/tsuya.ksy and lists the sections of files with what it makes: node check.mjs FILE...
// For each file a line: its name, the version, and for each section tag, codec, stored bytes. Ends with 3 where the compiler is not installed.
import { readFileSync, writeFileSync, mkdtempSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";

const require = createRequire(import.meta.url);
let compiler, yaml, KaitaiStream;
try {
    compiler = require("kaitai-struct-compiler");
    yaml = require("yaml");
    KaitaiStream = require("kaitai-struct").KaitaiStream;
} catch (error) {
    if (error.code !== "MODULE_NOT_FOUND") throw error;
    console.error("kaitai-struct-compiler is not installed: npm ci in tools/kaitai");
    process.exit(3);
}

const description = yaml.parse(readFileSync(new URL("../../spec/tsuya.ksy", import.meta.url), "utf8"));
const sources = await compiler.compile("javascript", description, null, false);
const folder = mkdtempSync(join(tmpdir(), "tsuya-"));
try {
    const runtime = JSON.stringify(require.resolve("kaitai-struct/KaitaiStream"));
    const source = sources["Tsuya.js"].replaceAll("'kaitai-struct/KaitaiStream'", runtime).replaceAll("\"kaitai-struct/KaitaiStream\"", runtime);
    writeFileSync(join(folder, "Tsuya.cjs"), source);
    const made = require(join(folder, "Tsuya.cjs"));
    const Tsuya = made.Tsuya ?? made;
    for (const path of process.argv.slice(2)) {
        const bytes = readFileSync(path);
        const file = new (Tsuya.Tsuya ?? Tsuya)(new KaitaiStream(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length)));
        // Positions that are read when they are asked for.
        void file.endSignature;
        const listed = (headers) => headers.map((h) => `${h.tag}:${h.codec}:${h.storedLength.value}:${h.crc32.toString(16).padStart(8, "0")}`).join(" ");
        const sections = listed(file.sections.map((section) => section.header));
        if (sections !== listed(file.directory.headers)) throw new Error(`${path}: the directory differs`);
        console.log(`${basename(path)} ${file.versionMajor}.${file.versionMinor} ${sections}`);
    }
} finally {
    rmSync(folder, { recursive: true });
}
