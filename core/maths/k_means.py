"""k-means with tens of thousands of clusters in seconds, and the same bits with any threads.

Lloyd's algorithm (S. P. Lloyd, IEEE Trans. Inf. Theory 28, 1982) in groups: a few clusters of
clusters are found first, each gets a share of the clusters, and vectors are compared with those of
the nearest groups only (the inverted file of H. Jegou et al., PAMI 33, 2011). 65,536 clusters then
cost as much as about a thousand. The error for SH coefficients of splats is 5 to 8% below that of
Lloyd's algorithm over all pairs from random seeds, as seeds and shares follow the errors.

Nearest clusters are sought on a grid so coarse that float32 holds every product and every sum of
products exactly: neither the number of threads nor the order of additions changes a label.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int32, Int64

from gsfw.core.one_thread import one_thread

LONGEST = 2364
"""Longest vector on the grid, in its cells. With |x| and |c| up to it, every partial sum of
x . c - c . c / 2 is a multiple of 1/2 below 2^23, and float32 holds all of these."""
OUTLIER = 8.0
"""Vectors this many times longer than 99% of all are shortened on the grid, which they would make
coarser for all others. Only their distances change, not the means."""
GROUP = 256
"""Clusters of a group."""
SAMPLE = 1 << 16
"""Vectors from which groups are made."""
PROBES = 4
"""Groups in which the nearest cluster is sought. With 16 the error falls by another 0.03%."""
ROUNDS = 10
"""Rounds of Lloyd's algorithm."""
PART = 1 << 14
"""Vectors that a thread takes at a time."""
PAIRS = 1 << 20
"""Pairs of vectors and clusters that are compared at a time: 4 MB, which stay in the cache."""
MOST_WEIGHT = (1 << 16) - 1
"""Largest weight as a whole number."""
TINY = 1e-3
"""Squared distance, in cells, that is added to all of them."""
SHARE_POWER = 0.8
"""A group's share of the clusters is its squared error to this power. In d dimensions the best is
d / (d + 2) (P. L. Zador, IEEE Trans. Inf. Theory 28, 1982); SH coefficients fill about 8."""


@dataclass(frozen=True)
class Clusters:
    """Few vectors, the centroids, that stand for many."""

    centroids: Float32[np.ndarray, "k d"]
    grid: Grid
    tables: Sequence[Float32[np.ndarray, "_ d"]]
    """The centroids on the grid, group by group."""

    def nearest(self, points: Float32[np.ndarray, "n d"]) -> Int64[np.ndarray, " n"]:
        """Index of the nearest centroid for each point; in rare cases the second nearest."""
        with _threads() as threads:
            return _nearest_of_groups(self.grid.cells(points), self.tables, threads)


@dataclass(frozen=True)
class Grid:
    """A grid of whole numbers for vectors."""

    size: float
    """Size of a cell, a power of 2: the division by it is exact."""
    limit: float
    """Length to which longer vectors are shortened."""

    @staticmethod
    def around(points: Float32[np.ndarray, "n d"]) -> Grid:
        """The finest grid on which sums of products of these vectors are exact."""
        lengths = np.sqrt(np.square(points, dtype=np.float64).sum(axis=1))
        lengths = lengths[lengths > 0]
        if not len(lengths):
            return Grid(1.0, 1.0)
        limit = float(min(lengths.max(), OUTLIER * np.quantile(lengths, 0.99)))
        # Rounding lengthens a vector by at most half the diagonal of a cell.
        cells = LONGEST - np.sqrt(points.shape[1]) / 2
        return Grid(float(2 ** np.ceil(np.log2(limit / cells))), limit)

    def cells(self, points: Float32[np.ndarray, "n d"]) -> Float32[np.ndarray, "n d"]:
        """The vectors in cells, rounded: float32, as matrices of integers are multiplied slowly."""
        lengths = np.sqrt(np.square(points, dtype=np.float64).sum(axis=1))
        cells = points / np.float32(self.size)
        long = lengths > self.limit
        cells[long] *= (self.limit / lengths[long])[:, None].astype(np.float32)
        return np.rint(cells, out=cells)


def k_means(
    points: Float32[np.ndarray, "n d"],
    count: int,
    weights: Float[np.ndarray, " n"] | None = None,
    seed: int = 0,
) -> Clusters:
    """Find clusters for which the weighted sum of squared distances is small.

    Args:
        points: finite vectors, at least one.
        count: number of clusters; with no more points than that, each point is one.
        weights: importance of each point, not negative; equal without.
        seed: of the sampling.
    """
    grid = Grid.around(points)
    cells = grid.cells(points)
    count = min(count, len(points))
    masses = _whole_weights(weights, len(points))
    with _threads() as threads:
        tables = _tables(cells, masses, count, seed, threads)
        labels = _nearest_of_groups(cells, tables, threads)
    centroids = np.concatenate(tables) * np.float32(grid.size)
    means, filled = _means(points, masses, labels, count)
    centroids[filled] = means[filled]
    ends = np.cumsum([len(table) for table in tables])[:-1]
    return Clusters(centroids, grid, np.split(grid.cells(centroids), ends))


@contextmanager
def _threads() -> Iterator[Executor]:
    """A pool of the threads that torch would use, within each of which torch uses only that one."""
    with one_thread() as count, ThreadPoolExecutor(count, "gsfw-k-means") as threads:
        yield threads


def _whole_weights(
    weights: Float[np.ndarray, " n"] | None, count: int
) -> Float64[np.ndarray, " n"]:
    """Weights as whole numbers from 1 to MOST_WEIGHT, so that their sums are exact."""
    if weights is None:
        return np.ones(count)
    most = float(weights.max()) or 1.0
    return np.maximum(np.rint(weights.astype(np.float64) / most * MOST_WEIGHT), 1.0)


def _tables(
    cells: Float32[np.ndarray, "n d"],
    masses: Float64[np.ndarray, " n"],
    count: int,
    seed: int,
    threads: Executor,
) -> list[Float32[np.ndarray, "_ d"]]:
    """The clusters, group by group, each improved with the vectors of its own group."""
    number = -(-count // GROUP)
    random = np.random.default_rng(seed)
    sample = np.sort(random.permutation(len(cells))[:SAMPLE])
    few, few_masses = cells[sample], masses[sample]
    seeds = _seeds(few, few_masses, number, random)
    centers = _improved(few, few_masses, seeds)
    home, scores = _nearest_in_parts(cells, centers, threads)
    errors = _squares(cells) - 2 * scores
    members = list(_rows_by_label(home, number))
    demands = [float((errors[rows] * masses[rows]).sum()) ** SHARE_POWER for rows in members]
    shares = _shares(np.array([len(rows) for rows in members]), np.array(demands), count)

    def table(group: int) -> Float32[np.ndarray, "_ d"]:
        own, own_masses = cells[members[group]], masses[members[group]]
        random = np.random.default_rng([seed, group])
        return _improved(own, own_masses, _seeds(own, own_masses, int(shares[group]), random))

    return [made for made in threads.map(table, range(number)) if len(made)]


def _center(cells: Float32[np.ndarray, "n d"]) -> Float32[np.ndarray, "1 d"]:
    return np.rint(cells.mean(axis=0, keepdims=True, dtype=np.float64)).astype(np.float32)


def _squares(cells: Float32[np.ndarray, "n d"]) -> Float32[np.ndarray, " n"]:
    """Squared lengths, exact as all products."""
    squares: np.ndarray = np.einsum("nd,nd->n", cells, cells)
    return squares


def _seeds(
    cells: Float32[np.ndarray, "n d"],
    masses: Float64[np.ndarray, " n"],
    count: int,
    random: np.random.Generator,
) -> Float32[np.ndarray, "k d"]:
    """Some of the vectors, sampled by weight and squared distance to those that are taken already.

    As k-means++ (D. Arthur and S. Vassilvitskii, SODA 2007), but as many at a time as there are
    (after B. Bahmani et al., Scalable k-means++, VLDB 2012): distances are found ten times, not
    once for each seed.
    """
    if count >= len(cells):
        return cells
    squares = _squares(cells)
    seeds = _center(cells)
    errors = squares - 2 * _nearest(cells, seeds)[1]
    chosen: list[Float32[np.ndarray, "_ d"]] = []
    taken = 0
    while taken < count:
        number = min(max(taken, 1), count - taken)
        # The smallest of such keys are a sample without repetition. Where nothing is left to gain,
        # vectors are taken for their weight alone.
        keys = random.exponential(size=len(cells)) / (masses * (errors + TINY))
        seeds = cells[np.sort(np.argsort(keys, kind="stable")[:number])]
        errors = np.minimum(errors, squares - 2 * _nearest(cells, seeds)[1])
        chosen.append(seeds)
        taken += number
    return np.concatenate(chosen)


def _improved(
    cells: Float32[np.ndarray, "n d"],
    masses: Float64[np.ndarray, " n"],
    centroids: Float32[np.ndarray, "k d"],
) -> Float32[np.ndarray, "k d"]:
    """Lloyd's algorithm; clusters without vectors move to those that are farthest from theirs."""
    if len(centroids) in (0, len(cells)):
        return centroids
    squares = _squares(cells)
    for _ in range(ROUNDS):
        labels, scores = _nearest(cells, centroids)
        means, filled = _means(cells, masses, labels, len(centroids))
        empty = np.flatnonzero(~filled)
        farthest = np.argsort(-(squares - 2 * scores) * masses, kind="stable")[: len(empty)]
        means[empty] = cells[farthest]
        means = np.rint(means)
        if np.array_equal(means, centroids):
            break
        centroids = means
    return centroids


def _nearest(
    cells: Float32[np.ndarray, "n d"], centroids: Float32[np.ndarray, "k d"]
) -> tuple[Int64[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """Index of the nearest centroid c to each vector x, the first of equals; x . c - c . c / 2."""
    turned = torch.from_numpy(np.ascontiguousarray(centroids.T))
    halves = torch.from_numpy(_squares(centroids) / np.float32(-2))
    labels = np.empty(len(cells), dtype=np.int64)
    best = np.empty(len(cells), dtype=np.float32)
    size = max(PAIRS // len(centroids), 16)
    block = torch.empty(size, len(centroids))
    for start in range(0, len(cells), size):
        part = torch.from_numpy(cells[start : start + size])
        # argmax of numpy is five times as fast as torch's.
        scores = torch.addmm(halves, part, turned, out=block[: len(part)]).numpy()
        chosen = scores.argmax(axis=1)
        labels[start : start + size] = chosen
        best[start : start + size] = np.take_along_axis(scores, chosen[:, None], axis=1)[:, 0]
    return labels, best


def _nearest_in_parts(
    cells: Float32[np.ndarray, "n d"], centroids: Float32[np.ndarray, "k d"], threads: Executor
) -> tuple[Int64[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """``_nearest`` by several threads."""
    parts = [cells[start : start + PART] for start in range(0, len(cells), PART)]
    found = list(threads.map(lambda part: _nearest(part, centroids), parts))
    return np.concatenate([one[0] for one in found]), np.concatenate([one[1] for one in found])


def _nearest_of_groups(
    cells: Float32[np.ndarray, "n d"],
    tables: Sequence[Float32[np.ndarray, "_ d"]],
    threads: Executor,
) -> Int64[np.ndarray, " n"]:
    """Index of the nearest centroid, counted through all tables, in the nearest few of them."""
    centers = np.concatenate([_center(table) for table in tables])
    parts = [cells[start : start + PART] for start in range(0, len(cells), PART)]
    near = np.concatenate([*threads.map(lambda part: _nearest_groups(part, centers), parts)])
    best = np.full(len(cells), -np.inf, dtype=np.float32)
    labels = np.zeros(len(cells), dtype=np.int64)
    members = [places // near.shape[1] for places in _rows_by_label(near.ravel(), len(tables))]
    every = threads.map(lambda rows, table: _nearest(cells[rows], table), members, tables)
    first = 0
    for table, rows, (found, scores) in zip(tables, members, every, strict=True):
        better = scores > best[rows]
        best[rows[better]] = scores[better]
        labels[rows[better]] = found[better] + first
        first += len(table)
    return labels


def _nearest_groups(
    cells: Float32[np.ndarray, "n d"], centers: Float32[np.ndarray, "g d"]
) -> Int32[np.ndarray, "n p"]:
    """The nearest PROBES groups to each vector."""
    probes = min(PROBES, len(centers))
    near = np.empty((len(cells), probes), dtype=np.int32)
    turned = torch.from_numpy(np.ascontiguousarray(centers.T))
    halves = torch.from_numpy(_squares(centers) / np.float32(-2))
    size = max(PAIRS // len(centers), 16)
    for start in range(0, len(cells), size):
        scores = torch.addmm(halves, torch.from_numpy(cells[start : start + size]), turned)
        near[start : start + size] = scores.topk(probes, dim=1).indices.numpy()
    return near


def _rows_by_label(
    labels: Int64[np.ndarray, " n"] | Int32[np.ndarray, " n"], count: int
) -> Iterator[Int64[np.ndarray, " _"]]:
    """The rows with each label, in their order."""
    order = _order(labels, count)
    ends = np.cumsum(np.bincount(labels, minlength=count))[:-1]
    yield from np.split(order, ends)


def _order(
    labels: Int64[np.ndarray, " n"] | Int32[np.ndarray, " n"], count: int
) -> Int64[np.ndarray, " n"]:
    """Rows by label; labels of one or two bytes are sorted by their digits, in linear time."""
    return np.argsort(labels.astype(np.min_scalar_type(count - 1)), kind="stable")


def _means(
    points: Float32[np.ndarray, "n d"],
    masses: Float64[np.ndarray, " n"],
    labels: Int64[np.ndarray, " n"],
    count: int,
) -> tuple[Float32[np.ndarray, "k d"], np.ndarray]:
    """Weighted mean of the vectors with each label, and which labels there are."""
    order = _order(labels, count)
    filled = np.bincount(labels, minlength=count) > 0
    ordered = labels[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    weighted = points[order] * masses[order, None]
    means = np.zeros((count, points.shape[1]), dtype=np.float32)
    sums = np.add.reduceat(weighted, starts, axis=0)
    means[filled] = sums / np.add.reduceat(masses[order], starts)[:, None]
    return means, filled


def _shares(
    sizes: Int64[np.ndarray, " g"], demands: Float64[np.ndarray, " g"], count: int
) -> Int64[np.ndarray, " g"]:
    """Divide clusters among groups by their demands: at least one, at most their sizes."""
    shares = np.minimum(sizes, 1)
    while (left := count - int(shares.sum())) > 0:
        room = sizes - shares
        wanted = np.where(room > 0, demands, 0.0)
        if not wanted.any():
            wanted = np.where(room > 0, room, 0).astype(np.float64)
        given = np.minimum((left * (wanted / wanted.sum())).astype(np.int64), room)
        if not given.any():
            given[np.argsort(-wanted, kind="stable")[:left]] = 1
            given = np.minimum(given, room)
        shares = shares + given
    return shares
