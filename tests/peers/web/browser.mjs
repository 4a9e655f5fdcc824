// Starts a headless Chromium that draws WebGL by the driver asked for, or not at all.

import { accessSync, constants, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { delimiter, join } from "node:path";
import { chromium } from "playwright-core";

const PROGRAMS = ["chromium", "chromium-browser", "google-chrome"];

const WEBGL = {
  // Mesa's OpenGL ES: without a GPU llvmpipe, the rasteriser that lavapipe offers as Vulkan.
  mesa: ["--use-gl=angle", "--use-angle=gl-egl"],
  swiftshader: ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
};

/** A page of a new browser, and what closes it without leaving anything. */
export async function launch(driver) {
  const profile = mkdtempSync(join(tmpdir(), "peers-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: find(PROGRAMS),
    headless: true,
    // Else Chromium would fall back on SwiftShader without a word.
    ignoreDefaultArgs: ["--enable-unsafe-swiftshader"],
    args: [
      "--no-sandbox",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
      "--ignore-gpu-blocklist",
      ...WEBGL[driver],
    ],
  });
  const close = async () => {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  };
  return { page: context.pages()[0] ?? (await context.newPage()), close };
}

/** A program of one of these names on the path. */
function find(names) {
  for (const folder of process.env.PATH.split(delimiter)) {
    for (const name of names) {
      try {
        accessSync(join(folder, name), constants.X_OK);
        return join(folder, name);
      } catch {
        // The next one.
      }
    }
  }
  throw new Error(`no browser: none of ${names.join(", ")} is on the path`);
}
