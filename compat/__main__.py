"""Runs a script that was written for CUDA rasterizers, unmodified, on a rasterizer of gsfw.

python -m gsfw.compat train.py ARGUMENTS
"""

from __future__ import annotations

import argparse
import os
import re
import runpy
import sys
import traceback
from contextlib import nullcontext
from pathlib import Path

PACKAGES = {
    "cv2": "opencv-python-headless",
    "PIL": "pillow",
    "pytorch_msssim": "pytorch-msssim",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
    "yaml": "pyyaml",
}
"""Packages whose name is not that of their module."""
WRONG_COUNT = re.compile(r"not enough values to unpack \(expected \d+, got [23]\)")
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
    sys.exit(run(given.script, given.always))


def run(script: Path, always: bool) -> int:
    """Run a script with replaced modules, and without CUDA on the CPU.

    Returns:
        The exit code: 0, or 1 or 2 after a message.
    """
    import torch

    from gsfw.api import UserError
    from gsfw.compat.cuda_on_cpu import CudaOnCpu
    from gsfw.compat.replacement import replace_modules

    gpu = torch.cuda.is_available()
    done = replace_modules(always, gpu)
    notes = [f"{', '.join(done.replaced) or 'nothing'} replaced"]
    notes += (
        [f"{', '.join(done.kept)} kept as installed (--always replaces it)"] if done.kept else []
    )
    if not gpu:
        notes += [
            "there is no GPU, so installed ones are replaced too",
            "the device cuda stands for the CPU",
        ]
    notes.append(f"rasterizer {os.environ.get('GSFW_RASTERIZER', 'auto')}")
    _say(f"gsfw.compat: {'; '.join(notes)}.")
    try:
        with nullcontext() if gpu else CudaOnCpu():
            runpy.run_path(str(script), run_name="__main__")
    except ModuleNotFoundError as error:
        return _explain_missing(script, error)
    except UserError as error:
        _say(f"{_place(script, error)}: {error.message} {error.advice}")
        return error.exit_code
    except ValueError as error:
        traceback.print_exc()
        if WRONG_COUNT.search(str(error)):
            _say(
                "If this line calls GaussianRasterizer, its fork returns a third image: run with "
                "--third depth or --third invdepth."
            )
        return 1
    return 0


def _explain_missing(script: Path, error: ModuleNotFoundError) -> int:
    """Name the package that a script needs."""
    module = (error.name or "").split(".")[0]
    if error.name != module:
        # Of a package that is there: one of its modules is not.
        traceback.print_exc()
        _say(f"{module} has no module {error.name}: is this {module} the one that it needs?")
        return 1
    _say(
        f"{_place(script, error)}: the package {module!r} is not installed. Install what the "
        f"script's own requirements name, or: pip install {PACKAGES.get(module, module)}"
    )
    return 2


def _place(script: Path, error: BaseException) -> str:
    """The line of the script's own code that led to an error."""
    folder = script.resolve().parent
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if folder in Path(frame.filename).resolve().parents]
    return f"{own[-1].filename}:{own[-1].lineno}" if own else str(script)


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


if __name__ == "__main__":
    main()
