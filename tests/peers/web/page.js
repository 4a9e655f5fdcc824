// One player in a page of its own: opens the field that the address names, draws the work's first
// frame, and then does what the driver calls `window.peer` for.
//
// A player is a module that exports `open(canvas, field, work)`, which resolves to an object with
// `gl`, the WebGL2 context; `draw(frame)`, which hands one frame to the GPU; and `sorted()`, which
// resolves once the player has sorted for the frame handed over last.

const query = new URLSearchParams(location.search);
const work = await (await fetch("/data/work.json")).json();

// It is not put on the page: only drawing is measured, not what the browser does with the picture.
const canvas = document.createElement("canvas");

const { open } = await import(`./${query.get("player")}.js`);
const player = await open(canvas, `/data/${query.get("field")}`, work);
const gl = player.gl;

/** Blocks until the GPU has done all that it was handed: a pixel cannot be read before. */
function finish() {
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

/** Lets messages arrive, such as those of workers that sort. */
function breathe() {
  return new Promise((resolve) => setTimeout(resolve));
}

/** The frame as rows from the top, red, green, blue, drawn after asking for its order so many times. */
async function picture(frame, asked) {
  for (let i = 0; i < asked; i++) {
    player.draw(frame);
    finish();
    await player.sorted();
  }
  player.draw(frame);
  const { width, height } = work;
  const rgba = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  const rgb = new Uint8Array(3 * width * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const from = 4 * ((height - 1 - y) * width + x);
      rgb.set(rgba.subarray(from, from + 3), 3 * (y * width + x));
    }
  }
  return rgb;
}

await picture(work.frames[0], 1);
// Counted from the moment at which the browser was sent to this page.
const firstMs = performance.now();
const info = gl.getExtension("WEBGL_debug_renderer_info");

window.peer = {
  firstMs,
  device: gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER),

  /** Milliseconds of every frame, from handing it over to when the GPU is done. */
  async play() {
    const ms = [];
    for (const frame of work.frames) {
      await breathe();
      const start = performance.now();
      player.draw(frame);
      finish();
      ms.push(performance.now() - start);
    }
    return ms;
  },

  /** The picture of a frame, base64. */
  async picture(index) {
    // The first answer may be to what was asked for another frame.
    const rgb = await picture(work.frames[index], 2);
    let text = "";
    for (let i = 0; i < rgb.length; i += 0x8000) {
      text += String.fromCharCode(...rgb.subarray(i, i + 0x8000));
    }
    return btoa(text);
  },
};
