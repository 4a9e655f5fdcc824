// gsplat.js with its program for dynamic fields.
//
// As shipped, its reader of .splatv loses the x coordinates that it sorts by; `open` does the same
// as a user's page. `gsplat-mended.js` puts them back.

import { Camera, Matrix3, Quaternion, Scene, SplatvLoader, Vector3, VideoRenderProgram, WebGLRenderer } from "gsplat";

/** Longest wait for an order, in milliseconds. */
const PATIENCE = 500;

export async function open(canvas, field, work) {
  return show(canvas, work, await load(field));
}

/** The scene of a .splatv file, and its animation. */
export async function load(field) {
  const scene = new Scene();
  const splatv = await SplatvLoader.LoadAsync(field, scene, null);
  return { scene, splatv };
}

/** A player of the scene. */
export function show(canvas, work, { scene }) {
  // No passes: the default one fades the scene in.
  const renderer = new WebGLRenderer(canvas, []);
  const program = new VideoRenderProgram(renderer, []);
  renderer.addProgram(program);
  const camera = new Camera();
  aim(camera, work.frames[0]);

  renderer.setSize(work.width, work.height);
  let worker = null;
  let answered = false;
  let waiting = [];
  const draw = (frame) => {
    aim(camera, frame);
    withTime(frame.t, () => renderer.render(scene, camera));
    if (worker === null) {
      worker = renderer.renderProgram.worker;
      worker.addEventListener("message", ({ data }) => {
        if (!data.depthIndex) return;
        answered = true;
        waiting.forEach((resolve) => resolve());
        waiting = [];
      });
    }
  };
  const sorted = () => {
    const answer = new Promise((resolve) => waiting.push(resolve));
    // Once it has sorted, it only does so again for another view.
    const patience = new Promise((resolve) => answered && setTimeout(resolve, PATIENCE));
    return Promise.race([answer, patience]);
  };
  return { gl: renderer.gl, draw, sorted };
}

/** Sets the camera to that of a frame. */
function aim(camera, { camera: { K, world_to_camera: m } }) {
  camera.data.fx = K[0][0];
  camera.data.fy = K[1][1];
  const column = (c) => [m[0][c], m[1][c], m[2][c]];
  const rows = [column(0), column(1), column(2)];
  const t = column(3);
  const position = rows.map((row) => -(row[0] * t[0] + row[1] * t[1] + row[2] * t[2]));
  camera.position = new Vector3(...position);
  camera.rotation = Quaternion.FromMatrix3(new Matrix3(...rows.flat()));
}

/** Runs `draw` at the clock's time at which the program shows clip time `t`: it swings by a sine. */
function withTime(t, draw) {
  const now = Date.now;
  Date.now = () => 1000 * Math.asin(2 * t - 1);
  try {
    draw();
  } finally {
    Date.now = now;
  }
}
