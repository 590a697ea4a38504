"""Promises of strategies."""

from __future__ import annotations

from gsfw.testing.promise import Promise

PROMISES: tuple[Promise, ...] = ()
