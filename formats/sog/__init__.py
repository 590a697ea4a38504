"""SOG (PlayCanvas, Spatially Ordered Gaussians): splats as a few images and their description.

https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/, version 2. Texel i of
each image is splat i, in Morton order. The frame is that of the PLY that was converted.
"""
