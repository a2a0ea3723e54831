// Where the bytes come from. A source hands over what arrives, in any order, and wakes those who wait.
import { TsuyaError } from "./errors.js";

/** Bytes asked for before anything is known of the file: the head, and mostly mesh and views. */
const FIRST = 32768;
/** Ranges this close to each other are fetched together: a request costs about as much. */
const NEAR = 1024;

/** A source of what was passed to `openTsuya`. */
export function sourceOf(source, { range = null, request = {} } = {}) {
  return typeof source === "string" ? new HttpSource(source, range, request) : new MemorySource(source, range);
}

class Source {
  /** Length of the file, null where it is not known. */
  length = null;
  /** Whether any range can be asked for. */
  seekable = true;
  /** Bytes that have arrived. */
  received = 0;
  /** Why nothing will arrive any more. */
  failure = null;
  /** Called with the place and the bytes of every piece. */
  onBytes = () => {};
  /** Called when the length is known after all. */
  onEnd = () => {};
  #waiting = new Set();

  /** Resolves when more has arrived; rejects where fetching fails. */
  arrival(signal) {
    return new Promise((resolve, reject) => {
      const waiter = { resolve: () => settle(resolve), reject: (error) => settle(reject, error) };
      const onAbort = () => waiter.reject(signal.reason);
      const settle = (how, what) => {
        this.#waiting.delete(waiter);
        signal.removeEventListener("abort", onAbort);
        how(what);
      };
      signal.addEventListener("abort", onAbort);
      this.#waiting.add(waiter);
    });
  }

  deliver(offset, bytes) {
    if (bytes.length === 0) return;
    this.received += bytes.length;
    this.onBytes(offset, bytes);
    this.wake();
  }

  /** The file turns out to end here. */
  endAt(length) {
    if (this.length !== null) return;
    this.length = length;
    this.onEnd(length);
    this.wake();
  }

  wake(error = null) {
    for (const waiter of [...this.#waiting]) error ? waiter.reject(error) : waiter.resolve();
  }
}

/** A blob or bytes. */
class MemorySource extends Source {
  #whole;
  #start;
  #running = new Set();
  name;

  constructor(whole, range) {
    super();
    this.#whole = whole instanceof ArrayBuffer ? new Uint8Array(whole) : whole;
    this.name = whole.name ?? null;
    const size = this.#whole.size ?? this.#whole.length;
    this.#start = Math.min(range?.offset ?? 0, size);
    this.length = Math.min(range?.length ?? Infinity, size - this.#start);
  }

  async start() {}

  want(ranges) {
    for (const gap of ranges.flatMap(([start, end]) => notRunning(start, end, this.#running))) {
      this.#read(...gap).catch((cause) => {
        this.wake(new TsuyaError("io", `can't be read: ${cause.message}`, { source: this.name, cause }));
      });
    }
  }

  async #read(start, end) {
    const running = { start, end };
    this.#running.add(running);
    try {
      const place = [this.#start + start, this.#start + end];
      const part = this.#whole instanceof Uint8Array
        ? this.#whole.subarray(...place)
        : new Uint8Array(await this.#whole.slice(...place).arrayBuffer());
      this.deliver(start, part);
    } finally {
      this.#running.delete(running);
    }
  }

  release() {}
  close() {}
}

/** An address. Ranges where the server has them, else everything from the start. */
class HttpSource extends Source {
  #url;
  #start;
  #limit;
  #request;
  #version = null;
  /** Requests under way: what they still bring, and for whom. */
  #running = new Set();

  constructor(url, range, request) {
    super();
    this.#url = url;
    this.#start = range?.offset ?? 0;
    this.#limit = range?.length ?? null;
    this.#request = request;
  }

  get name() {
    return this.#url;
  }

  /** Sends the first request; resolves when its answer has begun. */
  async start(signal) {
    const running = this.#open(0, Math.min(FIRST, this.#limit ?? FIRST), null);
    const abort = () => running.controller.abort(signal.reason);
    signal.addEventListener("abort", abort);
    try {
      const response = await this.#fetch(running);
      const [status, total] = [response.status, totalOf(response)];
      if (status === 206) {
        this.#version = versionOf(response);
        const length = total === null ? this.#limit : Math.min(this.#limit ?? Infinity, total - this.#start);
        this.length = length === null ? null : Math.max(length, 0);
      } else if (status === 416) {
        this.length = 0;
        this.#running.delete(running);
        return;
      } else {
        this.seekable = false;
        running.end = Infinity;
        const whole = response.headers.get("Content-Encoding") ? null : response.headers.get("Content-Length");
        const length = whole === null ? this.#limit : Math.min(this.#limit ?? Infinity, Number(whole) - this.#start);
        this.length = length === null ? null : Math.max(length, 0);
      }
      this.#pump(running, response);
    } catch (error) {
      this.#running.delete(running);
      throw error;
    } finally {
      signal.removeEventListener("abort", abort);
    }
  }

  /** Fetches what of `ranges` is not under way, for `owner`. */
  want(ranges, owner) {
    if (!this.seekable) return;
    for (const [start, end] of merged(ranges)) {
      for (const running of this.#running) {
        if (running.owners && running.start < end && start < running.end) running.owners.add(owner);
      }
      for (const gap of notRunning(start, end, this.#running)) {
        const running = this.#open(...gap, new Set([owner]));
        this.#fetch(running)
          .then((response) => {
            if (response.status === 416) return this.#ended(running, gap[0]);
            if (response.status !== 206 || versionOf(response) !== this.#version) {
              throw new TsuyaError("io", "the file has changed while it was read", { source: this.#url });
            }
            return this.#pump(running, response);
          })
          .catch((error) => this.#failed(running, error));
      }
    }
  }

  /** Nobody works for `owner` any more: what only it wanted is not fetched further. */
  release(owner) {
    for (const running of this.#running) {
      if (running.owners?.delete(owner) && running.owners.size === 0) running.controller.abort();
    }
  }

  close() {
    for (const running of this.#running) running.controller.abort();
  }

  #open(start, end, owners) {
    const running = { start, end, owners, controller: new AbortController() };
    this.#running.add(running);
    return running;
  }

  async #fetch(running) {
    const headers = new Headers(this.#request.headers);
    headers.set("Range", `bytes=${this.#start + running.start}-${this.#start + running.end - 1}`);
    let response;
    try {
      response = await fetch(this.#url, { ...this.#request, headers, signal: running.controller.signal });
    } catch (cause) {
      if (running.controller.signal.aborted) throw running.controller.signal.reason;
      throw new TsuyaError("io", `can't be fetched: ${cause.message}`, { source: this.#url, cause });
    }
    if (!response.ok && response.status !== 416) {
      throw new TsuyaError("io", `${response.status} ${response.statusText}`.trim(), { source: this.#url });
    }
    return response;
  }

  /** Hands over an answer's body as it arrives. */
  async #pump(running, response) {
    const whole = response.status !== 206;
    // Bytes of a whole answer that stand before the file, where it is a part of something.
    let skip = whole ? this.#start : 0;
    try {
      const reader = response.body.getReader();
      for (;;) {
        const { done, value } = await reader.read();
        if (done) break;
        let bytes = value.subarray(Math.min(skip, value.length));
        skip -= value.length - bytes.length;
        if (this.#limit !== null) bytes = bytes.subarray(0, Math.max(this.#limit - running.start, 0));
        const at = running.start;
        running.start += bytes.length;
        this.deliver(at, bytes);
        if (whole && running.start === this.#limit) {
          running.controller.abort();
          break;
        }
      }
      this.#ended(running, running.start);
    } catch (cause) {
      this.#failed(running, cause);
    }
  }

  #ended(running, at) {
    this.#running.delete(running);
    if (running.start < running.end) {
      if (this.length === null) {
        this.endAt(at);
      } else if (at < this.length) {
        const message = `the connection ended after ${this.received} bytes`;
        this.#fail(new TsuyaError("io", message, { source: this.#url }));
      }
    }
    this.wake();
  }

  #failed(running, cause) {
    if (!this.#running.delete(running) || running.controller.signal.aborted) return;
    const error = cause instanceof TsuyaError
      ? cause
      : new TsuyaError("io", `the connection broke: ${cause.message}`, { source: this.#url, cause });
    this.#fail(error);
  }

  /** Ranges can be asked for again, a stream from the start can't. */
  #fail(error) {
    if (!this.seekable) this.failure = error;
    this.wake(error);
  }
}

/** What of a range no request under way brings. */
function notRunning(start, end, requests) {
  let gaps = [[start, end]];
  for (const running of requests) {
    gaps = gaps.flatMap(([a, b]) => [[a, Math.min(b, running.start)], [Math.max(a, running.end), b]].filter(([a, b]) => a < b));
  }
  return gaps;
}

/** Ranges in order, near ones as one. */
function merged(ranges) {
  const result = [];
  for (const [start, end] of [...ranges].sort((a, b) => a[0] - b[0])) {
    const last = result.at(-1);
    if (last && start <= last[1] + NEAR) last[1] = Math.max(last[1], end);
    else result.push([start, end]);
  }
  return result;
}

/** Length of the whole that a part was sent of. */
function totalOf(response) {
  const total = response.headers.get("Content-Range")?.split("/")[1];
  return total && /^\d+$/.test(total) ? Number(total) : null;
}

/** What changes with the file. */
function versionOf(response) {
  return [response.headers.get("ETag"), response.headers.get("Last-Modified"), totalOf(response)].join();
}
