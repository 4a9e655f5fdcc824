// Plays fields in a browser. Reads requests from stdin, a line of JSON each, and answers each with a
// line of JSON; see `src/player.rs` for both. Arguments: the player, what draws for WebGL (mesa or
// swiftshader), and the folder that holds the fields and the work.

import { writeFile } from "node:fs/promises";
import { createInterface } from "node:readline";
import { launch } from "./browser.mjs";
import { serve } from "./server.mjs";

/** Longest wait for a first picture, in milliseconds. */
const PATIENCE = 120_000;

/** Answers for `player` until nothing more is asked. */
async function answer(player, driver, data) {
  const { server, origin } = await serve(data);
  const { page, close } = await launch(driver);
  let fail;
  const failed = new Promise((_, reject) => (fail = reject));
  // It is only looked at while a page opens.
  failed.catch(() => {});
  page.on("pageerror", fail);

  const requests = {
    async open({ field }) {
      await page.goto(`${origin}/web/index.html?player=${player}&field=${encodeURIComponent(field)}`);
      await Promise.race([page.waitForFunction("window.peer", null, { timeout: PATIENCE }), failed]);
      return page.evaluate("({ first_ms: peer.firstMs, device: peer.device })");
    },
    async play() {
      return { frames_ms: await page.evaluate("peer.play()") };
    },
    async picture({ frame, out }) {
      await writeFile(out, Buffer.from(await page.evaluate(`peer.picture(${frame})`), "base64"));
      return {};
    },
  };
  try {
    for await (const line of createInterface({ input: process.stdin })) {
      const [[request, about]] = Object.entries(JSON.parse(line));
      console.log(JSON.stringify(await requests[request](about)));
    }
  } finally {
    await close();
    server.close();
  }
}

const [player, driver, data] = process.argv.slice(2);
try {
  await answer(player, driver, data);
} catch (error) {
  console.error(`${player}: ${error.message}`);
  process.exit(1);
}
