"""Interfaces of other projects' rasterizers, on any backend of gsfw."""
