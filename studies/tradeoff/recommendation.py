"""Recommendation: the command that meets a user's wish, for finished models and for training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gsfw.studies.tradeoff.front import SAME_PSNR


@dataclass(frozen=True)
class Wish:
    """Bounds that the recommended variant has to meet; ``None`` for no bound."""

    psnr: float | None = None
    """Least PSNR in dB."""
    megabytes: float | None = None
    """Largest file."""
    ms: float | None = None
    """Longest time to render a view, with its spread."""

    def __str__(self) -> str:
        """The bounds in words; empty without any."""
        asked = [
            f"at least {self.psnr:.2f} dB" if self.psnr is not None else "",
            f"at most {self.megabytes:g} MB" if self.megabytes is not None else "",
            f"at most {self.ms:g} ms" if self.ms is not None else "",
        ]
        return " and ".join(text for text in asked if text)


@dataclass(frozen=True)
class Offer:
    """A variant that may be recommended."""

    name: str
    psnr: float
    """In dB."""
    megabytes: float | None
    """Size of the file, or of the parameters if no verb writes a file; ``None`` if unknown."""
    ms: float | None
    """Median time to render a view; ``None`` if unknown."""
    ms_spread: float = 0.0
    command: str = ""
    """Makes the variant and can be pasted; empty where no verb makes it."""
    seconds: float | None = None
    """Seconds of training; ``None`` for a variant that needs none."""

    def meets(self, wish: Wish) -> bool:
        """True if it is good, small and fast enough; an unknown figure is not."""
        return (
            (wish.psnr is None or self.psnr >= wish.psnr)
            and _within(self.megabytes, wish.megabytes)
            and _within(self.slowest, wish.ms)
        )

    @property
    def slowest(self) -> float | None:
        """Median and spread together, so that a variant within a budget is so on most days."""
        return None if self.ms is None else self.ms + self.ms_spread

    def __str__(self) -> str:
        """The figures in words."""
        parts = [f"{self.psnr:.2f} dB"]
        parts += [] if self.megabytes is None else [f"{self.megabytes:.2f} MB"]
        parts += [] if self.ms is None else [f"{self.ms:.1f} ms"]
        parts += [] if self.seconds is None else [f"{self.seconds:.0f} s of training"]
        return ", ".join(parts)


@dataclass(frozen=True)
class Recommendation:
    """One sentence, and the command in it."""

    text: str
    command: str = ""
    """Can be pasted; empty where there is none."""


def recommend(offers: Sequence[Offer], wish: Wish, usual: tuple[Wish, str]) -> Recommendation:
    """The best of the variants that meet a wish; a variant that a verb makes, if there is one.

    The smallest file where accuracy is asked for; else the most accurate one, and of those that are
    equal to 0.01 dB the smallest. Of files of one size, the one that is trained in less time, else
    the more accurate one.

    Args:
        offers: variants, at least one.
        wish: of the user.
        usual: taken where nothing is asked for, with its words.
    """
    asked = str(wish)
    if not asked:
        wish, asked = usual
    meeting = [offer for offer in offers if offer.meets(wish)]
    if not meeting:
        return Recommendation(f"{asked}: no variant has it.{_nearest(offers, wish)}")
    made = [offer for offer in meeting if offer.command]
    best = min(made or meeting, key=lambda offer: _order(offer, wish))
    if not made:
        return Recommendation(f"{asked}: {best.name} has it ({best}), but no verb makes it yet.")
    return Recommendation(f"For {asked}: {best.command} ({best}).", best.command)


def _within(value: float | None, bound: float | None) -> bool:
    return bound is None or (value is not None and value <= bound)


def _order(offer: Offer, wish: Wish) -> tuple[float, ...]:
    """The smallest comes first."""
    size = float("inf") if offer.megabytes is None else offer.megabytes
    if wish.psnr is not None:
        return size, offer.seconds or 0.0, -offer.psnr
    return -float(round(offer.psnr / SAME_PSNR)), size


def _nearest(offers: Sequence[Offer], wish: Wish) -> str:
    """The most accurate variant within the budgets; else the best of each figure asked for."""
    within = [offer for offer in offers if offer.meets(replace(wish, psnr=None))]
    if within and wish.psnr is not None:
        best = max(within, key=lambda offer: offer.psnr)
        return f" {best.name} comes nearest, {wish.psnr - best.psnr:.2f} dB short ({best})."
    sizes = [offer.megabytes for offer in offers if offer.megabytes is not None]
    times = [offer.slowest for offer in offers if offer.slowest is not None]
    said = []
    if wish.psnr is not None:
        said.append(f"{max(offer.psnr for offer in offers):.2f} dB at most")
    if wish.megabytes is not None and sizes:
        said.append(f"{min(sizes):.2f} MB at least")
    if wish.ms is not None and times:
        said.append(f"{min(times):.1f} ms at least, spread included")
    return f" There is {', '.join(said)}." if said else ""
