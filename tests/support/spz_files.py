"""SPZ files of tests, and the nearness that their numbers of bits allow."""

import math

from gsfw.core.exchange import SplatFile
from gsfw.formats.spz.exporter import SpzExporter
from gsfw.formats.spz.importer import SpzImporter
from support.splat_files import alignment, largest


def write(path, content, version=3, sh_bits=4):
    content = content if isinstance(content, SplatFile) else SplatFile(content)
    SpzExporter(version=version, sh_bits=sh_bits).write(path, content)
    return path


def read(path):
    return SpzImporter().read(path)


def rotation_bound(version):
    """Least |q . p| of a rotation and what is read: see the derivation.

    Version 2 rounds x, y and z to steps of 1/127.5, an error of at most d = sqrt(3) / 255 together;
    w^2 = 1 - |xyz|^2 changes by at most d (2 + d), and w >= 0 by no more than the root of that.
    Later versions round three components to steps of sqrt(1/2) / 511; the fourth is at least 1/2,
    so that it changes by |w'^2 - w^2| / (w' + w) <= sqrt(3) d + d^2, doubled for its own change.
    """
    if version == 2:
        step = math.sqrt(3) / 255
        distance = math.sqrt(step**2 + step * (2 + step))
    else:
        step = math.sqrt(3) * math.sqrt(0.5) / 511 / 2
        distance = math.hypot(step, 2 * (math.sqrt(3) * step + step**2))
    return 1 - distance**2 / 2 - 1e-6


def check_within_quantisation(given, again, version, bits=12, sh_bits=4):
    """Every value is as near as its number of bits allows."""
    assert largest(again.means, given.means) <= 0.5 / 2**bits + 1e-6
    assert largest(again.opacities, given.opacities) <= 0.5 / 255 + 1e-6
    assert largest(again.scales.log(), given.scales.log()) <= 1 / 32 + 1e-5
    assert alignment(again.quats, given.quats) >= rotation_bound(version)
    before, after = given.colors.coefficients, again.colors.coefficients
    assert largest(after[:, :1], before[:, :1]) <= 0.5 / (0.15 * 255) + 1e-5
    # Rounded to a step of 1/128, then to the middle of a bucket of some.
    first, others = (1 << (8 - kept) for kept in (min(sh_bits + 1, 8), sh_bits))
    if given.colors.degree:
        assert largest(after[:, 1:4], before[:, 1:4]) <= (0.5 + first // 2) / 128 + 1e-5
    if given.colors.degree > 1:
        assert largest(after[:, 4:], before[:, 4:]) <= (0.5 + others // 2) / 128 + 1e-5
