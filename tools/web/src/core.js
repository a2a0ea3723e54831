// The WebAssembly module: bytes in, objects with typed arrays out.
import { TsuyaError } from "./errors.js";

/** Numbers of the operations. */
export const OPERATION = { open: 0, mesh: 1, reflectance: 2, visibility: 3, light: 4, materials: 5, view: 6, verify: 7, ahead: 8, sections: 9, surface: 10 };
/** How a call ended. */
export const STATUS = { here: 0, missing: 1, error: 2, again: 3 };

/** Bits of the components in the flags of a view. */
export const COMPONENTS = { diffuse: 2, specular: 4, combined: 8 };

const ARRAYS = {
  f32: Float32Array,
  f16: Uint16Array,
  u32: Uint32Array,
  u8: Uint8Array,
  i8: Int8Array,
};

/** Compiles the module from its address, its bytes, or as it is. */
export async function compile(where) {
  if (where instanceof WebAssembly.Module) return where;
  if (where instanceof ArrayBuffer || ArrayBuffer.isView(where)) return WebAssembly.compile(where);
  const local = await localBytes(where);
  if (local) return WebAssembly.compile(local);
  let response;
  try {
    response = await fetch(where);
  } catch (cause) {
    throw new TsuyaError("io", `can't be fetched: ${cause.message}`, { source: String(where), cause });
  }
  if (!response.ok) {
    throw new TsuyaError("io", `${response.status} ${response.statusText}`.trim(), { source: String(where) });
  }
  // Compiling while it arrives wants the right type from the server; without it the bytes do.
  if (response.headers.get("Content-Type")?.startsWith("application/wasm")) {
    return WebAssembly.compileStreaming(response);
  }
  return WebAssembly.compile(await response.arrayBuffer());
}

/** The bytes of a `file:` address in Node, whose `fetch` knows none of these; null elsewhere. */
export async function localBytes(address) {
  if (!/^file:/i.test(String(address))) return null;
  // Not imported, so that what bundles this for browsers has nothing to look for.
  const files = globalThis.process?.getBuiltinModule?.("node:fs");
  if (!files) return null;
  try {
    return new Uint8Array(await files.promises.readFile(new URL(address)));
  } catch (cause) {
    throw new TsuyaError("io", `can't be read: ${cause.message}`, { source: String(address), cause });
  }
}

/** One file in one instance of the module. */
export class Core {
  #exports;
  #broken = null;

  /** `length` is null where it is not known; `seekable` says that ranges can be fetched. */
  constructor(module, length, seekable, memoryMib) {
    this.#exports = new WebAssembly.Instance(module, {}).exports;
    this.#call("tsuya_open", length ?? -1, seekable ? 1 : 0, memoryMib);
  }

  /** Hands over bytes of the file. */
  give(offset, bytes) {
    const pointer = this.#call("tsuya_input", bytes.length);
    new Uint8Array(this.#exports.memory.buffer, pointer, bytes.length).set(bytes);
    if (this.#call("tsuya_give", offset) === STATUS.error) throw this.#error();
  }

  /** Says where the file ends. */
  end(length) {
    this.#call("tsuya_end", length);
  }

  /**
   * Runs an operation: `{ status, value }`; `value` is the result or the missing ranges `[start, end]`. `spare` are buffers that the
   * arrays of the result may lie in.
   */
  run(operation, argument = 0, flags = 0, spare = []) {
    const status = this.#call("tsuya_run", operation, argument, flags);
    if (status === STATUS.error) throw this.#error();
    if (status === STATUS.again) return { status, value: null };
    const value = JSON.parse(this.#text(0));
    return { status, value: status === STATUS.here ? this.#withArrays(value, spare) : value };
  }

  #call(name, ...numbers) {
    if (this.#broken) throw this.#broken;
    try {
      return this.#exports[name](...numbers) >>> 0;
    } catch (cause) {
      this.#broken = new TsuyaError("internal", `the decoder failed (${cause.message}${this.#panic()})`, { cause });
      throw this.#broken;
    }
  }

  #panic() {
    try {
      const pointer = this.#exports.tsuya_panic() >>> 0;
      const length = this.#exports.tsuya_panic_length() >>> 0;
      const place = new TextDecoder().decode(new Uint8Array(this.#exports.memory.buffer, pointer, length));
      return place && ` at ${place}`;
    } catch {
      return "";
    }
  }

  #bytes(index) {
    const pointer = this.#call("tsuya_output", index);
    return new Uint8Array(this.#exports.memory.buffer, pointer, this.#call("tsuya_output_length", index));
  }

  #text(index) {
    return new TextDecoder().decode(this.#bytes(index));
  }

  #error() {
    const { kind, message, section, offset } = JSON.parse(this.#text(0));
    return new TsuyaError(kind, message, { section, offset });
  }

  /** Puts copies of the outputs where the description says. */
  #withArrays(value, spare) {
    value?.arrays?.forEach(([path, kind], index) => {
      const keys = Array.isArray(path) ? path : [path];
      const holder = keys.slice(0, -1).reduce((object, key) => object[key], value);
      const bytes = this.#bytes(index + 1);
      const fitting = spare.findIndex((buffer) => buffer.byteLength === bytes.length);
      const [buffer] = fitting < 0 ? [new ArrayBuffer(bytes.length)] : spare.splice(fitting, 1);
      new Uint8Array(buffer).set(bytes);
      holder[keys.at(-1)] = new ARRAYS[kind](buffer);
    });
    if (value) delete value.arrays;
    return value;
  }
}

/** The buffers of a result, to be handed to another thread without a copy. */
export function buffers(value) {
  const found = [];
  const visit = (item) => {
    if (ArrayBuffer.isView(item)) found.push(item.buffer);
    else if (item && typeof item === "object") Object.values(item).forEach(visit);
  };
  visit(value);
  return found;
}
