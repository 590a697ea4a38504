"""Whether the native CPU module is there, and what this machine can run."""

from __future__ import annotations

NOT_BUILT = (
    "the native CPU module was not built: no working C++ compiler was found at installation. "
    "Install one (Debian: apt install g++; macOS: xcode-select --install), "
    "then: pip install --force-reinstall --no-deps ."
)


def instruction_sets() -> list[str]:
    """Instruction sets this machine can run, the best first; empty when the module is not built."""
    try:
        from gsfw.kernels.cpu import _native
    except ImportError:
        return []
    return _native.instruction_sets()
