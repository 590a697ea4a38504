"""Resolving: turns layers of values into the settings of a run, part by part."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from gsfw.core.config import AUTO, MethodConfig, SlotConfig, replace_at
from gsfw.core.errors import ConfigError
from gsfw.core.files.mirror import MEGABYTE
from gsfw.core.step_settings import Rescaled, step_settings
from gsfw.plugins.automatic import (
    BUILT_IN_SCENE,
    USUAL_CHOICE,
    Choice,
    choose_datamanager,
    choose_device,
    choose_profile,
)
from gsfw.plugins.keys import (
    SLOT_KEYS,
    Key,
    current_key,
    current_value,
    keys,
    renamed_keys,
    suggest_key,
)
from gsfw.plugins.loading import ask_all, callback_configs, load
from gsfw.plugins.registry import Registry, did_you_mean
from gsfw.plugins.settings import (
    CHOICE_KEYS,
    COMMAND_LINE,
    METHOD_DEFAULT,
    Layer,
    Rank,
    Settings,
    last,
    where,
)
from gsfw.plugins.specs import Spec
from gsfw.plugins.values import as_text, describe, parse

DEFAULT_CHOICES = {"strategy": "adc", "sampler": "uniform"}
"""Values of ``auto`` that need no inspection."""
PRESET_CHOICES = {**DEFAULT_CHOICES, "datamanager": BUILT_IN_SCENE}
"""Parts that values of a preset are for, unless the method or the preset names others."""
PAPER = "paper"
"""Preset of every method: its own settings and, on data of the user's own, its number of steps.
Without it, a run on such data ends after a time (``planning.asked``)."""
PAPER_SETTINGS = {"optim.cooldown": 0.0}
"""The papers of the methods have no cooldown."""


class Resolving:
    """Settings during their resolution."""

    def __init__(
        self, registry: Registry, method: Spec, config: MethodConfig, layers: Sequence[Layer]
    ) -> None:
        self._registry, self._method = registry, method
        self._config = replace(config, callbacks=callback_configs(registry))
        self._layers = [*_presets(method, config, layers), *layers]
        self._notes: list[str] = []
        self._use_current_names()
        self._choices: dict[str, Spec] = {}
        self._rescaled: set[str] = set()
        self._sources: dict[str, str] = {"method": last(layers, "method")[1]}
        self._defaults = {slot: self._default_name(slot) for slot in SLOT_KEYS}

    def _default_name(self, slot: str) -> str:
        """Name of the method's own choice for a slot."""
        part = getattr(self._config, slot)
        if part is None:
            return AUTO
        target = f"{type(part).__module__}:{type(part).__qualname__}"
        for name, spec in self._registry.slot(slot).items():
            if spec.target == target:
                return name
        raise ConfigError(
            f"method {self._method.name!r} has {target} as its {slot}, which is not registered.",
            f"Its package ({self._method.distribution}) has to register it through a hook.",
        )

    def _use_current_names(self) -> None:
        """Rename values as the parts chosen so far declare."""
        renamed = renamed_keys(self._config)
        for layer in self._layers:
            if layer.source == COMMAND_LINE:
                for key, value in layer.values.items():
                    self._note_new_name(key, value, renamed)
        self._layers = [layer.with_current_names(renamed) for layer in self._layers]

    def _note_new_name(self, key: str, value: object, renamed: Mapping[str, str]) -> None:
        new = current_key(key, renamed)
        if new != key:
            change = f"was renamed to {new}" if new else "has no effect any more"
            self._notes.append(f"{key} {change}.")
        current = current_value(new, value, renamed)
        if current != value:
            self._notes.append(f"{new}={as_text(value)} was renamed to {new}={current}.")

    def choose(self, slot: str, recommended: Rank | None = None) -> None:
        """Fill a slot; the recommendations of the choice become a layer of that rank."""
        name, source = last(self._layers, slot)
        name = name or self._defaults[slot]
        if name == AUTO or (slot == "datamanager" and self._has_other_data()):
            choice = self._automatic(slot)
            name, source = choice.name, choice.source
        part = self._fill(slot, name, source)
        if recommended is not None:
            source = f"recommended by {slot} {name}"
            values = self._without_taken(source, self._with_values(slot, part).recommendations())
            self._layers.append(Layer(source, values, rank=recommended))
            self._layers.sort(key=lambda layer: layer.rank)

    def _without_taken(self, source: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Leave out recommended parts where the method has its own choice, which it may need."""
        kept = dict(values)
        for slot in SLOT_KEYS & values.keys():
            presets = [layer for layer in self._layers if layer.rank <= Rank.PRESET]
            own = last(presets, slot)[0] or self._defaults[slot]
            if own not in (AUTO, kept[slot]):
                left_out = kept.pop(slot)
                if last(self._given_layers, slot)[0] is None:
                    self._notes.append(
                        f"{source}: {slot}={left_out}, but method {self._method.name} has its own "
                        f"choice, {slot}={own}."
                    )
        return kept

    def share_steps(self) -> None:
        """Let views, rates and steps follow the number of processes, unless views are given.

        N processes render N times more views in a step, in as many fewer steps. Adam's rates then
        grow with the root of N, and its decay rates are raised to the power N (Malladi et al. 2022;
        for splats Zhao et al. 2024, Grendel-GS, section 4.3).
        """
        processes, key = int(self._config.processes), "sampler.views_per_step"
        given = [layer for layer in self._layers if "processes" in layer.values]
        if given:
            with suppress(ValueError):  # A wrong value is refused later.
                processes = int(as_text(given[-1].values["processes"]))
        assert self._config.sampler is not None
        sampler = self._with_values("sampler", self._config.sampler)
        views = getattr(sampler, "views_per_step", None)
        shards, _ = last(self._layers, "shards")
        if shards is not None and as_text(shards) != "0":  # They render the same views together.
            return
        if processes < 2 or views is None or any(key in layer.values for layer in self._layers):
            return
        steps, _ = last(self._layers, "steps")
        steps = str(self._config.steps) if steps is None else steps
        values = {key: processes * views, "optim.batch_scale": processes}
        if not any("steps" in layer.values for layer in self._given_layers) and steps.isdigit():
            values["steps"] = math.ceil(int(steps) / processes)
        source = f"recommended for processes={processes}"
        self._layers.append(Layer(source, values, rank=Rank.STRATEGY))
        self._layers.sort(key=lambda layer: layer.rank)

    def _with_values(self, slot: str, part: SlotConfig) -> SlotConfig:
        """A choice with the values given so far; wrong ones are refused later."""
        known = {f"{slot}.{key.name}": key for key in keys(part)}
        for _, name, value in self._given():
            if name in known:
                with suppress(ValueError):
                    part = replace_at(part, known[name].name, parse(known[name].kind, value))
        return part

    def _has_other_data(self) -> bool:
        """True if the layer with the data manager is for data that was replaced."""
        with_data = [layer for layer in self._layers if "data" in layer.values]
        named = [layer for layer in self._layers if "datamanager" in layer.values]
        return bool(named) and named[-1] in with_data[:-1]

    def _automatic(self, slot: str) -> Choice:
        if slot == "datamanager":
            data, _ = last(self._layers, "data")
            megabytes, _ = last(self._layers, "data_cache_mb")
            is_known = megabytes is not None and megabytes.isdecimal()
            most = int(megabytes or 0) * MEGABYTE if is_known else None
            place = self._config.data if data is None else data
            return choose_datamanager(place, self._registry, most)
        return Choice(DEFAULT_CHOICES[slot], USUAL_CHOICE)

    def _fill(self, slot: str, name: str, source: str) -> SlotConfig:
        spec = self._registry.find(slot, name)
        if name != self._defaults[slot]:
            self._config = replace(self._config, **{slot: load(slot, spec)()})
        self._choices[slot], self._sources[slot] = spec, source
        part: SlotConfig = getattr(self._config, slot)
        return part

    def apply_values(self, only: str = "") -> None:
        """Set all given values, except those of the rasterizer, which depends on the others."""
        self._use_current_names()
        known = {key.name: key for key in keys(self._config)}
        for layer, key, value in self._given():
            if key in CHOICE_KEYS or key.startswith("rasterizer.") != (only == "rasterizer"):
                continue
            if key in known:
                self._set(known[key], value, layer.source)
            elif layer.rank == Rank.STRATEGY:  # Made for methods that have it.
                self._notes.append(
                    f"{layer.source}: {key}={as_text(value)}, which method {self._method.name} "
                    "does not have."
                )
            elif layer.source == COMMAND_LINE or not self._is_of_another_callback(key):
                raise self._unknown(key, layer.source, known)

    def _is_of_another_callback(self, key: str) -> bool:
        """True if a setting belongs to a callback that is not installed; it changes no result."""
        group, _, rest = key.partition(".")
        return group == "callbacks" and not hasattr(self._config.callbacks, rest.split(".")[0])

    def _given(self) -> Iterator[tuple[Layer, str, object]]:
        """All values, except those of a choice that another one has replaced.

        A preset's ``strategy.*`` is for the method's own strategy, a file's for the strategy in the
        file; values without a strategy are for the chosen one. A preset's ``datamanager.*`` is for
        the built-in scene.
        """
        final = {slot: spec.name for slot, spec in self._choices.items()}
        usual = {slot: name for slot, name in self._defaults.items() if name != AUTO}
        given = dict(final)
        for layer in self._layers:
            own = layer.rank < Rank.GIVEN
            assumed = PRESET_CHOICES if layer.rank <= Rank.PRESET else DEFAULT_CHOICES
            in_force = {**final, **assumed, **usual} if own else given
            for slot in SLOT_KEYS:
                if slot in layer.values:
                    name = as_text(layer.values[slot])
                    in_force[slot] = final.get(slot, name) if name == AUTO else name
            for key, value in layer.values.items():
                slot = key.partition(".")[0]
                if "." not in key or in_force.get(slot) == final.get(slot):
                    yield layer, key, value

    def _set(self, key: Key, value: object, source: str) -> None:
        self._rescaled.discard(key.name)
        if isinstance(value, Rescaled):
            value = value.steps
            self._rescaled.add(key.name)
        try:
            parsed = parse(key.kind, value)
        except ValueError:
            raise ConfigError(
                f"{where(source)}{key.name}={as_text(value)}: "
                f"expected {describe(key.kind)}, found {as_text(value)!r}.",
                f"{key.name}: {key.help}" if key.help else "",
            ) from None
        self._config = replace_at(self._config, key.name, parsed)
        self._sources[key.name] = source

    def _unknown(self, key: str, source: str, known: Mapping[str, Key]) -> ConfigError:
        slot, _, setting = key.partition(".")
        hint = suggest_key(key, [*known, *CHOICE_KEYS])
        if slot not in SLOT_KEYS:
            slot, setting = "method", key
        known_by = ask_all(slot, self._registry, lambda kind: {item.name for item in keys(kind())})
        others = [name for name, names in known_by.items() if setting in names]
        if others:
            chosen = self._method if slot == "method" else self._choices[slot]
            hint = f" It belongs to {slot} {' and '.join(others)}, but {slot}={chosen.name}."
        return ConfigError(
            f"{where(source)}unknown key {key!r}.{hint}",
            f"All keys: gsfw train method={self._method.name} --help",
        )

    def choose_rasterizer(self) -> None:
        """Choose device, rasterizer and profile by the needs of the other parts; set its values.

        Raises:
            ConfigError: as for every other value.
        """
        name, source = last(self._layers, "rasterizer")
        name = name or self._defaults["rasterizer"]
        config = self._config
        needs = {"method": config.needs()}
        for part in (config.strategy, config.datamanager):
            assert part is not None
            needs[type(part).__name__] = part.needs()
        device, rasterizer = choose_device(config.device, name, self._registry, needs)
        if device is not None:
            self._config = replace(self._config, device=device.name)
            self._sources["device"] = device.source
        if rasterizer is not None:
            name, source = rasterizer.name, rasterizer.source
        self._fill("rasterizer", name, source)
        if config.profile == AUTO:
            profile = choose_profile(name, self._registry)
            self._config = replace(self._config, profile=profile.name)
            self._sources["profile"] = profile.source
        self.apply_values(only="rasterizer")

    def rescale(self, default_steps: int) -> None:
        """Rescale every schedule with a default or preset value to the run's length."""
        config = self._config
        if not config.rescale or config.steps == default_steps:
            return
        ratio = config.steps / default_steps
        for key, (value, floor) in step_settings(config).items():
            if (key not in self._sources or key in self._rescaled) and value > 0:
                steps = max(round(value * ratio), min(floor, value))
                self._config = replace_at(self._config, key, steps)
                source = self._sources.get(key, METHOD_DEFAULT)
                self._sources[key] = f"{source} x {ratio:.3g} (steps={config.steps})"

    def settings(self) -> Settings:
        """The resolved settings."""
        choices = {slot: self._choices[slot] for slot in SLOT_KEYS}
        sources = {
            key: self._sources.get(key, METHOD_DEFAULT)
            for key in ["method", *SLOT_KEYS, *(key.name for key in keys(self._config))]
        }
        preset, _ = last(self._given_layers, "preset")
        return Settings(
            self._method,
            self._config,
            choices,
            sources,
            given=self._given_keys(sources),
            planned=self._planned_keys(sources),
            preset=preset or "",
            notes=tuple(dict.fromkeys(self._notes)),
        )

    @property
    def _given_layers(self) -> list[Layer]:
        return [layer for layer in self._layers if layer.rank is Rank.GIVEN]

    def _given_keys(self, sources: Mapping[str, str]) -> tuple[str, ...]:
        """Keys whose value the user chose, and the choices that these values belong to."""
        given = self._named_keys(sources)
        given |= _slots(given)
        if "datamanager" in given:  # The user chose it for this data only.
            given.add("data")
        return tuple(key for key in sources if key in given)

    def _planned_keys(self, sources: Mapping[str, str]) -> tuple[str, ...]:
        """Keys whose value a plan decided, and choices that only these values belong to."""
        layers = {layer.source: layer.planned for layer in self._given_layers}
        planned = {key for key, source in sources.items() if key in layers.get(source, ())}
        chosen = self._named_keys(sources) - planned
        planned |= _slots(planned) - _slots(chosen) - chosen
        return tuple(key for key in sources if key in planned)

    def _named_keys(self, sources: Mapping[str, str]) -> set[str]:
        """Keys whose value is in a layer that gives it."""
        layers = {layer.source: layer for layer in self._given_layers}
        return {
            key for key, source in sources.items() if source in layers and layers[source].gives(key)
        }


def _slots(names: Iterable[str]) -> set[str]:
    """The slots of some keys."""
    return {key.partition(".")[0] for key in names} & {*SLOT_KEYS}


def preset_names(config: MethodConfig) -> tuple[str, ...]:
    """Names of all presets of a method: its own, and the one that every method has."""
    return tuple(dict.fromkeys([*config.presets, PAPER]))


def _presets(method: Spec, config: MethodConfig, layers: Sequence[Layer]) -> list[Layer]:
    """The preset named "default", if there is one, and the chosen one."""
    name, source = last(layers, "preset")
    known = preset_names(config)
    if name is not None and name not in known:
        raise ConfigError(
            f"{where(source)}method {method.name!r} has no preset {name!r}."
            f"{did_you_mean(name, known)}",
            f"Presets: {', '.join(known)}.",
        )
    presets = {"default": {}, PAPER: PAPER_SETTINGS, **config.presets}
    return [
        Layer(f"preset {key}", presets[key], rank=rank)
        for rank, key in ((Rank.DEFAULT_PRESET, "default"), (Rank.PRESET, name or "default"))
    ]
