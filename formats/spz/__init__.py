"""SPZ (Niantic): quantised splats, stream by stream, gzip or Zstandard; about a tenth of a PLY.

Layout of github.com/nianticlabs/spz, versions 1 to 4. The stored frame is x right, y up, z back.
"""
