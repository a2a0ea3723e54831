// A headless browser with a page that has the package loaded as `tsuya`.

import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

/** The page itself; servers of tests put it at `/page.html`. */
export const PAGE = Buffer.from(`<!doctype html><title>tsuya</title><link rel="icon" href="data:,">
<script type="module">import * as tsuya from "/src/tsuya.js"; window.tsuya = tsuya;</script>`);

/** Starts the browser; `{ open, close }`. `open` gives `{ page, complaints }` once the page has set this member of its window. */
export async function launch() {
  const profile = mkdtempSync(join(tmpdir(), "tsuya-browser-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    headless: true,
    args: [
      "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync",
    ],
  });
  const open = async (address, path = "/page.html", member = "tsuya") => {
    const page = await context.newPage();
    page.setDefaultTimeout(180_000);
    const complaints = [];
    page.on("pageerror", (error) => complaints.push(error.stack));
    page.on("console", (message) => {
      // Files that are missing on purpose.
      if (message.type() === "error" && !/status of 404|ERR_/.test(message.text())) complaints.push(message.text());
    });
    await page.goto(address + path);
    await page.waitForFunction((member) => window[member], member);
    return { page, complaints };
  };
  const close = async () => {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  };
  return { open, close };
}
