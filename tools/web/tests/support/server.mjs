// A small web server for tests: files and made-up ones, with or without ranges, as slow as wanted, and what was asked of it.

import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";

const TYPES = { ".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".wasm": "application/wasm" };
/** Bytes that a slow answer sends at a time. */
const PIECE = 2048;

/**
 * Serves `folder`, and over it `files` (a Map of paths to bytes). Query parameters of an address: `ranges=no` ignores ranges, `rate=N` sends N
 * bytes a second, `break=N` cuts the connection after N bytes, `unknown` sends no length. Returns `{ address, asked, end }`; `asked` lists
 * `{ path, start, end }` of what was sent.
 */
export function serve(folder, files = new Map()) {
  const asked = [];
  const server = createServer(async (request, answer) => {
    const url = new URL(request.url, "http://127.0.0.1");
    const path = normalize(decodeURIComponent(url.pathname));
    let bytes;
    try {
      bytes = files.get(path) ?? readFileSync(join(folder, path));
    } catch {
      answer.writeHead(404, "Not Found").end();
      return;
    }
    const headers = { "Content-Type": TYPES[extname(path)] ?? "application/octet-stream", "Cache-Control": "no-store" };
    const range = url.searchParams.get("ranges") === "no" ? null : /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "");
    let [start, end] = [0, bytes.length];
    if (range) {
      [start, end] = [Number(range[1]), Math.min(Number(range[2]) + 1, bytes.length)];
      if (start >= bytes.length) {
        answer.writeHead(416, { ...headers, "Content-Range": `bytes */${bytes.length}` }).end();
        return;
      }
      headers["Content-Range"] = `bytes ${start}-${end - 1}/${bytes.length}`;
    }
    if (!url.searchParams.has("unknown")) headers["Content-Length"] = end - start;
    asked.push({ path, start, end });
    answer.writeHead(range ? 206 : 200, headers);
    const [rate, broken] = ["rate", "break"].map((name) => Number(url.searchParams.get(name)) || Infinity);
    if (rate === Infinity && broken === Infinity) {
      answer.end(bytes.subarray(start, end));
      return;
    }
    for (let at = start; at < end && !answer.destroyed; at += PIECE) {
      if (at - start >= broken) {
        answer.destroy();
        return;
      }
      answer.write(bytes.subarray(at, Math.min(at + PIECE, end)));
      await new Promise((resolve) => setTimeout(resolve, (1000 * PIECE) / Math.min(rate, 1e7)));
    }
    answer.end();
  });
  return new Promise((resolve) => {
    server.listen(0, "127.0.0.1", () => {
      const end = () => {
        server.closeAllConnections();
        server.close();
      };
      resolve({ address: `http://127.0.0.1:${server.address().port}`, asked, end });
    });
  });
}
