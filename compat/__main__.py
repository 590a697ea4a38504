"""Runs a script that was written for CUDA rasterizers, unmodified, on a rasterizer of gsfw.

python -m gsfw.compat train.py ARGUMENTS
"""

from __future__ import annotations

import argparse
import os
import runpy
import sys
import traceback
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.compat.replacement import Replacement

THIRD = "GSFW_THIRD_OUTPUT"


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m gsfw.compat", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument(
        "--rasterizer", help="as in gsfw train rasterizer=NAME; the fastest that fits if not given"
    )
    parser.add_argument(
        "--third",
        choices=("none", "depth", "invdepth"),
        help="what GaussianRasterizer returns besides colour and radii, for forks",
    )
    parser.add_argument(
        "--always", action="store_true", help="replace modules that work on the GPU, too"
    )
    parser.add_argument(
        "--claim-gpu",
        action="store_true",
        help="without a GPU, let torch.cuda.is_available() be True, for scripts that require one",
    )
    parser.add_argument(
        "--without",
        metavar="PACKAGE",
        action="append",
        default=[],
        help="let the script import this package, which need not be installed; calls are errors",
    )
    parser.add_argument("script", type=Path, help="the script, such as train.py")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="of the script")
    return parser.parse_args()


def main() -> None:
    """Run the script."""
    given = arguments()
    if not given.script.is_file():
        sys.exit(f"There is no script {given.script}. Give its path after python -m gsfw.compat.")
    for name, value in (("GSFW_RASTERIZER", given.rasterizer), (THIRD, given.third)):
        if value is not None:
            os.environ[name] = value
    # As Python itself does for a script; here the place belongs to the folder of -m.
    sys.path[0] = str(given.script.resolve().parent)
    sys.argv = [str(given.script), *given.arguments]
    sys.exit(run(given))


def run(given: argparse.Namespace) -> int:
    """Run a script with replaced modules, and without CUDA on the CPU.

    Returns:
        The exit code: 0, or 1 or 2 after a message.
    """
    import torch

    from gsfw.api import UserError
    from gsfw.compat.absent import leave_out
    from gsfw.compat.cuda_on_cpu import CudaOnCpu
    from gsfw.compat.explanation import explain
    from gsfw.compat.replacement import replace_modules

    gpu = torch.cuda.is_available()
    try:
        _say(_first_line(replace_modules(given.always, gpu), gpu))
        leave_out(given.without)
        with nullcontext() if gpu else CudaOnCpu(given.claim_gpu):
            runpy.run_path(str(given.script), run_name="__main__")
    except (UserError, ImportError, ValueError, AssertionError, RuntimeError) as error:
        explained = explain(given.script, error, given.claim_gpu)
        if explained is None:
            raise
        if explained.traceback:
            traceback.print_exc()
        _say(explained.text)
        return explained.exit_code
    return 0


def _first_line(done: Replacement, gpu: bool) -> str:
    """The replacements in words."""
    notes = [f"{', '.join(done.replaced) or 'nothing'} replaced"]
    if done.kept:
        notes.append(f"{', '.join(done.kept)} kept as installed (--always replaces it)")
    if not gpu:
        notes.append("there is no GPU, so installed ones are replaced too")
        notes.append("the device cuda stands for the CPU")
    notes.append(f"rasterizer {os.environ.get('GSFW_RASTERIZER', 'auto')}")
    return f"gsfw.compat: {'; '.join(notes)}."


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


if __name__ == "__main__":
    main()
