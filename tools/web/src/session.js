// One open file: runs operations, fetching what they miss. Lives in a worker, or where the caller does without one beside it.
import { COMPONENTS, Core, OPERATION, STATUS } from "./core.js";
import { TsuyaError } from "./errors.js";
import { sourceOf } from "./source.js";

/** Views whose bytes are fetched ahead while one is decoded. */
const AHEAD = 8;

export class Session {
  #core;
  #source;
  #closing = new AbortController();
  /** Views are decoded one after the other. */
  #lastView = Promise.resolve();
  #opened = null;

  /** Called with `{ received, total }` when bytes have arrived. */
  onProgress = () => {};

  /** Opens a file; resolves with `{ facts, views, order }`. */
  async open(source, { module, memoryMib, range, request }, signal) {
    this.#source = sourceOf(source, { range, request });
    this.#source.onBytes = (offset, bytes) => this.#give(offset, bytes);
    this.#source.onEnd = (length) => this.#core?.end(length);
    const early = [];
    this.#give = (offset, bytes) => early.push([offset, bytes]);
    await this.#source.start(signal);
    this.#core = new Core(module, this.#source.length, this.#source.seekable, memoryMib);
    this.#give = (offset, bytes) => {
      this.#core.give(offset, bytes);
      this.onProgress(this.progress);
    };
    for (const piece of early) this.#give(...piece);
    this.#opened = await this.run("open", {}, signal);
    return this.#opened;
  }

  #give = () => {};

  get progress() {
    return { received: this.#source.received, total: this.#source.length };
  }

  /** Sections that are known by now. */
  sections() {
    return this.#core.run(OPERATION.sections).value;
  }

  /**
   * Runs an operation by its name. The options are for views: `next` are those to fetch ahead, `spare` buffers that nobody needs any more.
   */
  async run(name, { index = 0, format = "float32", components = Object.keys(COMPONENTS), next = [], spare = [] }, signal) {
    const both = AbortSignal.any([signal, this.#closing.signal]);
    if (name !== "view") return (await this.#complete([OPERATION[name]], both)).value;
    const flags = components.reduce((sum, component) => sum | (COMPONENTS[component] ?? 0), format === "half" ? 1 : 0);
    this.#ahead([index]);
    const before = this.#lastView;
    let done;
    this.#lastView = new Promise((resolve) => (done = resolve));
    try {
      await aborting(before, both);
      const running = this.#complete([OPERATION.view, index, flags, spare], both);
      this.#ahead(next.slice(0, AHEAD));
      const { value, milliseconds } = await running;
      return { ...value, milliseconds };
    } finally {
      // A view that was given up still waits for those before it, so that the order stays.
      before.then(done);
    }
  }

  close() {
    this.#closing.abort(new DOMException("the file was closed", "AbortError"));
    this.#source?.close();
  }

  /** Runs `what`, the arguments of `Core.run`, until it is done. */
  async #complete(what, signal) {
    const owner = {};
    let milliseconds = 0;
    try {
      for (;;) {
        signal.throwIfAborted();
        const began = performance.now();
        const { status, value } = this.#core.run(...what);
        milliseconds += performance.now() - began;
        if (status === STATUS.here) return { value, milliseconds };
        if (status === STATUS.missing) {
          if (this.#source.failure) throw this.#source.failure;
          const arrival = this.#source.arrival(signal);
          this.#source.want(value, owner);
          await arrival;
        } else {
          await turn();
        }
      }
    } catch (error) {
      this.#source.release(owner);
      throw this.#named(error);
    }
  }

  /** Fetches views' bytes before their turn. */
  #ahead(views) {
    if (!this.#opened) return;
    const count = this.#opened.views.length;
    for (const view of views) {
      if (!(view >= 0 && view < count)) continue;
      const { status, value } = this.#core.run(OPERATION.ahead, view);
      if (status === STATUS.missing) this.#source.want(value, this);
    }
  }

  #named(error) {
    if (error instanceof TsuyaError && !error.source && this.#source.name) {
      error.source = this.#source.name;
      error.message = `${error.source}: ${error.message}`;
    }
    return error;
  }
}

/** A promise that an abort rejects earlier. */
function aborting(promise, signal) {
  return new Promise((resolve, reject) => {
    const onAbort = () => reject(signal.reason);
    if (signal.aborted) return onAbort();
    signal.addEventListener("abort", onAbort, { once: true });
    promise.then(resolve, reject).finally(() => signal.removeEventListener("abort", onAbort));
  });
}

const turns = new MessageChannel();
const waiting = [];
turns.port1.onmessage = () => waiting.shift()?.();
turns.port1.unref?.();

/** Lets messages and bytes in that have come meanwhile. */
function turn() {
  return new Promise((resolve) => {
    waiting.push(resolve);
    turns.port2.postMessage(null);
  });
}
