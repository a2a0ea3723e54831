// The worker's side: messages to a session and back.
import { buffers } from "./core.js";
import { toPlain } from "./errors.js";
import { Session } from "./session.js";

const session = new Session();
const running = new Map();
let sectionsComplete = false;

session.onProgress = (progress) => postMessage({ progress });

onmessage = async ({ data }) => {
  if (data.cancel !== undefined) {
    running.get(data.cancel)?.abort(new DOMException("aborted", "AbortError"));
    return;
  }
  const { id, name } = data;
  const controller = new AbortController();
  running.set(id, controller);
  try {
    const value = name === "open"
      ? await session.open(data.source, data.options, controller.signal)
      : await session.run(name, data.options, controller.signal);
    const sections = sectionsComplete ? null : session.sections();
    sectionsComplete ||= sections.sectionsComplete;
    postMessage({ id, value, sections }, buffers(value));
  } catch (error) {
    postMessage({ id, error: toPlain(error) });
  } finally {
    running.delete(id);
  }
};
