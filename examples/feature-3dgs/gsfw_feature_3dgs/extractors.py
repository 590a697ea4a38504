"""Extractors: from images to feature maps, and from words to features.

A real one, such as CLIP or LSeg, is a class with these three members in any importable module,
given as extractor=package.module:Name. The built-in one needs no download: its features are the
basic colour terms, so that it understands words like "red" and "dark".
"""

from __future__ import annotations

from importlib import import_module
from typing import Protocol

import torch

from gsfw.api import ConfigError


class Extractor(Protocol):
    """Constructed without arguments, at the first image or word."""

    channels: int
    """Channels of a feature; of the class, so that a run is opened without constructing it."""

    def features(self, images: torch.Tensor) -> torch.Tensor:
        """Feature maps [c, h2, w2, channels] of images [c, h, w, 3] in [0, 1], at any size."""

    def words(self, text: str) -> torch.Tensor:
        """The feature [channels] of a text.

        Raises:
            ConfigError: it understands no words, or not these.
        """


TERMS = {
    "black": (0.05, 0.05, 0.05),
    "white": (0.95, 0.95, 0.95),
    "gray": (0.5, 0.5, 0.5),
    "red": (0.75, 0.15, 0.12),
    "orange": (0.95, 0.55, 0.15),
    "yellow": (0.95, 0.85, 0.25),
    "green": (0.25, 0.6, 0.25),
    "blue": (0.2, 0.4, 0.75),
    "purple": (0.5, 0.25, 0.6),
    "pink": (0.95, 0.65, 0.7),
    "brown": (0.45, 0.3, 0.18),
}
"""The eleven basic colour terms (Berlin and Kay 1969), each with an RGB colour of our choice."""
MEMBERS = ("channels", "features", "words")
SYNONYMS = {"grey": "gray", "dark": "black", "bright": "white", "violet": "purple"}
SHARPNESS = 40.0
"""Factor of negative squared distances of opponent colours in the softmax; neighbours share 0.2."""


class ColorTerms:
    """The share of each colour term in a pixel: a softmax over distances of opponent colours."""

    channels = len(TERMS)

    def features(self, images):
        terms = opponent(images.new_tensor(list(TERMS.values())))
        squares = (opponent(images)[..., None, :] - terms).square().sum(-1)
        return (-SHARPNESS * squares).softmax(-1)

    def words(self, text):
        names = [SYNONYMS.get(word, word) for word in text.lower().replace(",", " ").split()]
        unknown = [name for name in names if name not in TERMS]
        if unknown or not names:
            raise ConfigError(
                f"text={text}: extractor=colors knows no word {' '.join(unknown)!r}.",
                f"Its words: {', '.join([*TERMS, *SYNONYMS])}.",
            )
        found = torch.zeros(self.channels)
        for name in names:
            found[list(TERMS).index(name)] = 1.0
        return found / found.norm()


def opponent(colors):
    """Lightness, red less green, and yellow less blue; hue counts more than lightness."""
    red, green, blue = colors.unbind(-1)
    lightness = (red + green + blue) / 3
    return torch.stack([0.5 * lightness, red - green, 0.5 * (red + green) - blue], dim=-1)


def find_extractor(name: str) -> type[Extractor]:
    """The class of the built-in extractor, or that of package.module:Name.

    It is not constructed: names come from the settings of runs and model files, also of others'.

    Raises:
        ConfigError: there is none, or it has not the members of an extractor.
    """
    if name == "colors":
        return ColorTerms
    module, colon, attribute = name.partition(":")
    try:
        if not colon:
            raise ImportError("expected colors, or package.module:Name")
        found = getattr(import_module(module), attribute)
        missing = [member for member in MEMBERS if not hasattr(found, member)]
        if missing or not isinstance(found, type):
            raise AttributeError(f"it is no class with {', '.join(missing or MEMBERS)}")
        return found
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"extractor={name}: {error}.",
            "Give an importable class, package.module:Name, with the members of "
            "gsfw_feature_3dgs.extractors.Extractor.",
        ) from None
