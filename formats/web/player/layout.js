// Layout: numbers that the worker and the page share.

const ROW = 512;  // Splats in a row of the textures.
const MOTION = 20;  // Numbers that say how a splat moves.
const ORDER = 1024;  // Rows in a line of the texture that says in which order they are drawn.
const GROUP = 128;  // Splats of an instance: graphics cards draw few large ones faster.
