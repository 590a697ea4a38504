// The fields of a projected splat: one row of numbers per row of the model.
#pragma once

namespace gsfw {

/// Centre in pixels; r, -w k and w of the whitening u = r dx, v = w dy - w k dx, scaled so that
/// alpha is 2^(level - u^2 - v^2); level, which is log2 of the opacity. Then the ellipse as binning
/// needs it: how x leans with y; the height above the centre at which it reaches furthest right;
/// half its width at the centre's height; half the height and half the width of its bounding box.
/// Then the channels.
enum SplatField {
  SPLAT_X, SPLAT_Y, SPLAT_R, SPLAT_WK, SPLAT_W, SPLAT_LEVEL,
  SPLAT_TILT, SPLAT_TURN, SPLAT_NARROW, SPLAT_HEIGHT, SPLAT_WIDTH, SPLAT_CHANNELS
};

}  // namespace gsfw
