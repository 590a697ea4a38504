// Main: opens the page, and lets programs steer it.

const page = new Page(SCENE_ADDRESS ? fetched(SCENE_ADDRESS) : held());

/** For programs: cameras are OpenCV's, in the world of the data. */
window.gsfw = {
  /** A promise that is kept when the whole scene is shown. */
  ready: page.loaded,
  /** Look from a camera, in an image of its size; a promise of that. */
  setCamera(worldToCamera, intrinsics, width, height) {
    const { scene } = page;
    page.fix([width, height]);
    scene.camera.take(scene.camera.exactly(worldToCamera, intrinsics, width, height));
    return scene.settled();
  },
  /** Stop at a time in [0, 1]; a promise of that. */
  setTime: (time) => page.goTo(time),
  /** A promise of the canvas as a PNG, in a data address. */
  async image() {
    await page.scene.settled();
    return page.canvas.toDataURL("image/png");
  },
  /** Figures of the moment. */
  stats() {
    const { scene } = page, { camera } = scene;
    return {
      splats: scene.limit,
      drawn: scene.renderer.count,
      sortMilliseconds: scene.milliseconds,
      imagesPerSecond: page.rate,
      time: scene.time,
      position: plus(camera.position, scene.header.origin),
      forward: camera.axes[2],
      distance: camera.distance,
    };
  },
};
