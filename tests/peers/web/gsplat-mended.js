// gsplat.js as in `gsplat.js`, but with the x coordinates that its reader of .splatv overwrites,
// so that it sorts by where the Gaussians' centres are.

import { load, show } from "./gsplat.js";

/** Numbers of 32 bits in a row of the file, the first three of which are the centre. */
const ROW = 16;

export async function open(canvas, field, work) {
  const loaded = await load(field);
  const { data, positions } = loaded.splatv.data;
  const rows = new Float32Array(data.buffer);
  for (let i = 0; i < positions.length / 3; i++) {
    positions[3 * i] = rows[ROW * i];
  }
  return show(canvas, work, loaded);
}
