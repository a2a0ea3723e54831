// The interface; described in tsuya.d.ts.
import { buffers, compile, COMPONENTS, localBytes } from "./core.js";
import { fromPlain, TsuyaError } from "./errors.js";
import { Session } from "./session.js";

export { TsuyaError };

const DEFAULT_MEMORY_MIB = 1024;
/** The module, compiled once for an address. */
const modules = new Map();

export async function openTsuya(source, options = {}) {
  const { signal = null, range = null, request = {}, memoryMib = DEFAULT_MEMORY_MIB, onProgress = () => {} } = options;
  signal?.throwIfAborted();
  const useWorker = options.worker ?? typeof Worker === "function";
  const module = await compiled(options.wasm ?? new URL("tsuya.wasm", import.meta.url));
  signal?.throwIfAborted();
  const given = plainSource(source);
  const whole = (typeof given === "string" && (await localBytes(given))) || given;
  signal?.throwIfAborted();
  const file = new File(useWorker ? new WorkerLink() : new DirectLink(), signal, onProgress);
  const plainRequest = { ...request, headers: [...new Headers(request.headers)] };
  delete plainRequest.signal;
  try {
    await file.open(whole, { module, memoryMib, range, request: plainRequest });
  } catch (error) {
    file.close();
    throw error;
  }
  return file;
}

function compiled(where) {
  if (typeof where !== "string" && !(where instanceof URL)) return compile(where);
  const address = absolute(where);
  if (!modules.has(address)) {
    const module = compile(address);
    modules.set(address, module);
    module.catch(() => modules.delete(address));
  }
  return modules.get(address);
}

function absolute(address) {
  try {
    return new URL(address, globalThis.document?.baseURI ?? globalThis.location?.href).href;
  } catch (cause) {
    const inNode = globalThis.process?.getBuiltinModule ? ": Node takes bytes, or pathToFileURL(path)" : "";
    throw new TsuyaError("parameter", `'${address}' is no address${inNode}`, { cause });
  }
}

function plainSource(source) {
  if (typeof source === "string" || source instanceof URL) return absolute(source);
  if (source instanceof Blob || source instanceof ArrayBuffer || source instanceof Uint8Array) return source;
  throw new TsuyaError("parameter", "the source must be an address, a Blob, an ArrayBuffer or a Uint8Array");
}

class File {
  facts = null;
  views = [];
  order = [];
  progress = { received: 0, total: null };
  #link;
  #signal;
  #closed = null;

  constructor(link, signal, onProgress) {
    this.#link = link;
    this.#signal = signal;
    signal?.addEventListener("abort", () => this.#close(signal.reason), { once: true });
    link.onProgress = (progress) => {
      this.progress = progress;
      onProgress(progress);
    };
    link.onSections = (sections) => this.facts && Object.assign(this.facts, sections);
  }

  async open(source, options) {
    const { facts, views, order } = await this.#run("open", { source, options });
    Object.assign(this, { facts, views, order });
  }

  mesh(options) {
    return this.#run("mesh", {}, options);
  }
  surface(options) {
    return this.#run("surface", {}, options);
  }
  reflectance(options) {
    return this.#run("reflectance", {}, options);
  }
  visibility(options) {
    return this.#run("visibility", {}, options);
  }
  light(options) {
    return this.#run("light", {}, options);
  }
  async materials(options) {
    return (await this.#run("materials", {}, options)).materials;
  }
  async verify(options) {
    await this.#run("verify", {}, options);
  }

  async view(index, options = {}) {
    if (!Number.isInteger(index) || !(index >= 0 && index < this.views.length)) {
      throw new TsuyaError("parameter", `view ${index} does not exist: the file has ${this.views.length} views`);
    }
    return this.#view(index, [], options);
  }

  async *decodeViews(options = {}) {
    const wanted = options.views ? new Set(options.views) : null;
    const ordered = this.order.length > 0 ? this.order.map((step) => step.view) : this.views.keys();
    const list = [...ordered].filter((view) => wanted?.has(view) ?? true);
    let reuse = null;
    for (const [place, index] of list.entries()) {
      const view = await this.#view(index, list.slice(place + 1), { ...options, reuse });
      reuse = options.reuse ? view : null;
      yield view;
    }
  }

  #view(index, next, { format = "float32", components, reuse, signal }) {
    for (const component of components ?? []) {
      if (!(component in COMPONENTS)) throw new TsuyaError("parameter", `there is no component '${component}'`);
    }
    // Those given away before are empty.
    const spare = buffers(reuse).filter((buffer) => buffer.byteLength > 0);
    return this.#run("view", { index, next, format, components, spare }, { signal });
  }

  close() {
    this.#close(new DOMException("the file was closed", "AbortError"));
  }

  #close(reason) {
    if (this.#closed) return;
    this.#closed = reason;
    this.#link.close(reason);
  }

  async #run(name, options, { signal = null } = {}) {
    if (this.#closed) throw this.#closed;
    signal?.throwIfAborted();
    return this.#link.run(name, options, signal);
  }
}

/** A session on this thread. */
class DirectLink {
  #session = new Session();
  #closing = new AbortController();
  onProgress = () => {};
  onSections = () => {};

  async run(name, { source, options, ...others }, signal) {
    this.#session.onProgress = this.onProgress;
    const both = signal ? AbortSignal.any([signal, this.#closing.signal]) : this.#closing.signal;
    const value = name === "open"
      ? await this.#session.open(source, options, both).then((opened) => structuredClone(opened))
      : await this.#session.run(name, others, both);
    this.onSections(this.#session.sections());
    return value;
  }

  close(reason) {
    this.#closing.abort(reason);
    this.#session.close();
  }
}

/** A session in a worker. */
class WorkerLink {
  #worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
  #pending = new Map();
  #next = 0;
  onProgress = () => {};
  onSections = () => {};

  constructor() {
    this.#worker.onmessage = ({ data: { id, value, error, sections, progress } }) => {
      if (progress) return this.onProgress(progress);
      const call = this.#pending.get(id);
      this.#pending.delete(id);
      if (sections) this.onSections(sections);
      if (error) call?.reject(fromPlain(error));
      else call?.resolve(value);
    };
    this.#worker.onerror = (event) => {
      event.preventDefault();
      this.#end(new TsuyaError("internal", `the worker failed: ${event.message ?? "it can't be loaded"}`));
    };
  }

  run(name, { source, options, ...others }, signal) {
    return new Promise((resolve, reject) => {
      const id = this.#next++;
      const onAbort = () => {
        this.#worker.postMessage({ cancel: id });
        this.#pending.delete(id);
        reject(signal.reason);
      };
      const settled = (settle) => (what) => {
        signal?.removeEventListener("abort", onAbort);
        settle(what);
      };
      this.#pending.set(id, { resolve: settled(resolve), reject: settled(reject) });
      signal?.addEventListener("abort", onAbort, { once: true });
      this.#worker.postMessage({ id, name, source, options: options ?? others }, others.spare ?? []);
    });
  }

  close(reason) {
    this.#end(reason);
  }

  #end(reason) {
    this.#worker.terminate();
    for (const call of this.#pending.values()) call.reject(reason);
    this.#pending.clear();
  }
}
