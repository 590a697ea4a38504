"""Look-alikes: which images show the same, by the words of a visual vocabulary.

COLMAP's index (Schoenberger et al. 2016, "A vote-and-verify strategy for fast spatial verification
in image retrieval"): every feature counts for its nearest word, and words that few images have
count for more. The vocabulary is built of the capture's own features, so that nothing has to be
downloaded, or read from a file.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from gsfw.core.errors import ConfigError
from gsfw.core.progress import stage
from gsfw.preparation.cancellation import cancellable
from gsfw.preparation.native import names_by_number, opened_database

if TYPE_CHECKING:
    from pycolmap import Database

EACH = 1000
"""Features of an image that the vocabulary is built of, at most."""
SAMPLE = 100_000
"""Features of all images together that it is built of, at most: 15 s of k-means."""
FOR_A_WORD = 40
"""Features for each word. Of the five strongest partners of each of 50 photos of a fox, ten
look-alikes hold 0.94 with 256 words of 50,000 features, 0.99 with 1024, and 0.99 with 4096."""
WORDS = (64, 2500)
"""Fewest and most of them."""
ITERATIONS = 10
"""Iterations of k-means, after which words hardly move."""
COUNTED = 2000
"""Features of an image that are looked up, those of the largest scale."""
EMBEDDING = 64
"""Bits that tell features of one word apart: as many as COLMAP's own vocabularies have."""
SEED = 0
ADVICE = (
    "Expected a vocabulary tree of COLMAP 3.12 or later (faiss) for SIFT features; leave it out "
    "to build one of the images themselves."
)


def look_alikes(database: Path, vocabulary: Path | None) -> Mapping[str, Sequence[str]]:
    """All images in the order of their likeness to each, the most alike first.

    Those without any common word are missing.

    Args:
        database: with features.
        vocabulary: COLMAP's file; ``None`` to build one.

    Raises:
        ConfigError: the file is no vocabulary of SIFT features.
        DataError: COLMAP cannot work with the database.
    """
    if vocabulary is not None:
        check_vocabulary(vocabulary)
    with (
        TemporaryDirectory(dir=database.parent, prefix="vocabulary_") as folder,
        opened_database(database, "find look-alikes") as opened,
    ):
        names = names_by_number(opened)
        if vocabulary is None:
            features = _sample(opened, list(names))
            if len(features) < FOR_A_WORD * WORDS[0]:
                return {}
            vocabulary = Path(folder) / "words.bin"
            with stage("vocabulary", 1) as advance:
                build_vocabulary(vocabulary, features)
                advance(1)
        return _ranked(opened, names, vocabulary)


def check_vocabulary(path: Path) -> None:
    """Check that a file is a vocabulary that can be used.

    Raises:
        ConfigError: it is not.
    """
    import pycolmap

    try:
        index = pycolmap.VisualIndex.read(path)
    except (RuntimeError, ValueError, MemoryError) as error:
        found = (
            "is a vocabulary of COLMAP before 3.12 (flann), or none at all"
            if "file_version" in str(error)
            else "is damaged or no vocabulary"
        )
        raise ConfigError(f"vocabulary={path} {found}.", ADVICE) from error
    if index.feature_type() != pycolmap.FeatureExtractorType.SIFT:
        raise ConfigError(
            f"vocabulary={path} is of {index.feature_type().name} features, not SIFT.", ADVICE
        )


def build_vocabulary(path: Path, features: Float32[np.ndarray, "n 128"]) -> None:
    """Cluster features into words, and write them as COLMAP's file."""
    import pycolmap

    options = pycolmap.VisualIndex.BuildOptions()
    fewest, most = WORDS
    options.num_visual_words = min(most, max(fewest, len(features) // FOR_A_WORD))
    options.num_iterations = ITERATIONS
    options.num_rounds = 1
    options.num_threads = 1
    sift = pycolmap.FeatureExtractorType.SIFT
    descriptors = pycolmap.FeatureDescriptorsFloat(type=sift, data=features)
    index = pycolmap.VisualIndex.create(features.shape[1], EMBEDDING)
    pycolmap.set_random_seed(SEED)
    with _mute():
        cancellable(lambda token: index.build(options, descriptors))
    index.write(path)


@contextmanager
def _mute() -> Iterator[None]:
    """Keep native code off the terminal: faiss would like more words for its index of words."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def _sample(database: Database, numbers: Sequence[int]) -> Float32[np.ndarray, "n 128"]:
    """Some features of every image."""
    generator = np.random.default_rng(SEED)
    each = min(EACH, SAMPLE // max(1, len(numbers)))
    chosen = [np.zeros((0, 128), np.float32)]
    for number in numbers:
        rows = np.asarray(database.read_descriptors(number).data).reshape(-1, 128)
        chosen.append(rows[generator.permutation(len(rows))[:each]].astype(np.float32))
    return np.concatenate(chosen)


def _ranked(database: Database, names: Mapping[int, str], vocabulary: Path) -> dict[str, list[str]]:
    import pycolmap

    options = pycolmap.VocabTreePairingOptions()
    options.vocab_tree_path = vocabulary
    options.num_images = len(names)
    options.num_nearest_neighbors = 1
    options.max_num_features = COUNTED
    # With two threads, images of nearly the same likeness come in another order each time.
    options.num_threads = 1
    ranked: dict[str, list[str]] = {}
    with stage("look-alikes", len(names)) as advance:
        generator = cancellable(lambda token: pycolmap.VocabTreePairGenerator(options, database))
        while not generator.has_finished():
            for number, other in generator.next():
                if number != other:
                    ranked.setdefault(names[number], []).append(names[other])
            advance(len(ranked))
    return ranked
