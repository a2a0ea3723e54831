/** Everything that goes wrong, but for aborts. See `tsuya.d.ts`. */
export class TsuyaError extends Error {
  constructor(kind, message, { source = null, section = null, offset = null, cause } = {}) {
    super(source ? `${source}: ${message}` : message, cause === undefined ? undefined : { cause });
    this.name = "TsuyaError";
    this.kind = kind;
    this.source = source;
    this.section = section;
    this.offset = offset;
  }
}

/** What was thrown, as something that can be posted to another thread. */
export function toPlain(error) {
  if (error instanceof TsuyaError) {
    const { kind, message, source, section, offset } = error;
    return { kind, message, source, section, offset };
  }
  if (error?.name === "AbortError" || error?.name === "TimeoutError") {
    return { abort: error.message, name: error.name };
  }
  return { kind: "internal", message: String(error?.message ?? error), source: null, section: null, offset: null };
}

/** The error again. */
export function fromPlain(plain) {
  if (plain.abort !== undefined) return new DOMException(plain.abort, plain.name);
  const error = new TsuyaError(plain.kind, plain.message, plain);
  error.message = plain.message;
  return error;
}
