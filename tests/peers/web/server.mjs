// Serves the pages, the packages of npm and the fields to the browser of this machine.

import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));

const TYPES = {
  ".html": "text/html",
  ".js": "text/javascript",
  ".json": "application/json",
  ".wasm": "application/wasm",
};

/** Starts a server of `/web`, `/node_modules` and, from the folder `data`, `/data`. Resolves to it and its address. */
export async function serve(data) {
  const roots = { web: here, node_modules: join(here, "..", "node_modules"), data };
  const server = createServer(async (request, response) => {
    const [, root, ...rest] = decodeURIComponent(new URL(request.url, "http://host").pathname).split("/");
    const path = normalize(rest.join("/"));
    try {
      if (!Object.hasOwn(roots, root) || path.startsWith("..")) throw new Error("outside");
      const bytes = await readFile(join(roots[root], path));
      response.writeHead(200, {
        "content-type": TYPES[extname(path)] ?? "application/octet-stream",
        // With both, the clock of a page counts in microseconds.
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-embedder-policy": "require-corp",
      });
      response.end(bytes);
    } catch {
      response.writeHead(404).end();
    }
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return { server, origin: `http://127.0.0.1:${server.address().port}` };
}
