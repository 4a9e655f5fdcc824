// Spark, on three.js: a static field, such as an instant of a dynamic one.
//
// Blur and order are set to what fields are fitted with: 0.3 square pixels without making up for it
// in opacity, and depth. All else is as it comes.

import { Matrix4, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";

/** From the camera axes of the work, y down and z forward, to those of three.js. */
const FLIP = new Matrix4().makeScale(1, -1, -1);

export async function open(canvas, field, work) {
  const renderer = new WebGLRenderer({ canvas, antialias: false });
  renderer.setSize(work.width, work.height, false);
  const scene = new Scene();
  const spark = new SparkRenderer({ renderer, preBlurAmount: 0.3, blurAmount: 0, sortRadial: false });
  scene.add(spark);
  const mesh = new SplatMesh({ url: field });
  scene.add(mesh);
  await mesh.initialized;

  const camera = new PerspectiveCamera();
  const draw = (frame) => {
    aim(camera, frame.camera);
    renderer.render(scene, camera);
  };
  const sorted = async () => {
    do {
      await new Promise((resolve) => setTimeout(resolve, 20));
    } while (spark.sorting || spark.sortDirty);
  };
  return { gl: renderer.getContext(), draw, sorted };
}

/** Sets the camera to that of a frame. */
function aim(camera, { width, height, K, world_to_camera }) {
  camera.fov = (2 * Math.atan(height / 2 / K[1][1]) * 180) / Math.PI;
  camera.aspect = width / K[0][0] / (height / K[1][1]);
  camera.near = 0.01;
  camera.far = 1000;
  camera.updateProjectionMatrix();
  const world = new Matrix4().set(...world_to_camera.flat()).invert().multiply(FLIP);
  world.decompose(camera.position, camera.quaternion, camera.scale);
  camera.updateMatrixWorld();
}
