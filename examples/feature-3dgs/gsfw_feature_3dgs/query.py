"""`gsfw query`: finds words, or what resembles a point, in a run of method feature-3dgs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.api import ConfigError, RunOptions, read_options

NEIGHBORS = 16
"""Gaussians nearest to a point, whose mean feature is looked for."""
BEST = 0.01
"""Part of the Gaussians, by opacity times similarity, whose centre is reported."""


@dataclass(kw_only=True)
class QueryOptions(RunOptions):
    """Find words or a point in a model of features: heat maps of views, and a place in space."""

    examples = ('gsfw query latest text="red"', "gsfw query latest point=0.3,-0.1,1.2")

    text: str = ""
    """Words that the run's extractor understands."""
    point: tuple[float, ...] = ()
    """x,y,z in the world of the data: finds what resembles the Gaussians there."""
    out: str = ""
    """Folder of the heat maps. Empty: query/ in the run."""


def run(arguments: list[str]) -> int:
    options = read_options("query", QueryOptions, arguments)
    if bool(options.text) == bool(options.point):
        raise ConfigError("gsfw query: give text=WORDS, or point=X,Y,Z.")
    from gsfw.api import Console, open_run

    console, opened = Console(options.json), open_run(options.run, options.data, options.device)
    if not hasattr(opened.method, "relevance"):
        raise ConfigError(
            f"{opened.name} has no features.", "Train with method=feature-3dgs, and query that run."
        )
    vector = _vector(options, opened)
    run = Path(opened.name)
    folder = Path(options.out) if options.out else (run if run.is_dir() else run.parent) / "query"
    views = _write_views(opened, vector, folder)
    similarity, place = _best_place(opened, vector)
    best = max(views, key=lambda name: views[name]) if views else "none"
    console.say(f"best at ({', '.join(f'{x:.3g}' for x in place)}), similarity {similarity:.2f}")
    console.say(f"{len(views)} heat maps in {folder}; the hottest view is {best}")
    console.result({"place": place, "similarity": similarity, "views": views, "out": str(folder)})
    return 0


def _vector(options, opened):
    """The feature that is looked for."""
    import torch

    if options.text:
        return opened.method.extractor.words(options.text)
    if len(options.point) != 3:
        raise ConfigError(f"point={options.point}: expected three numbers, X,Y,Z.")
    point = torch.tensor(options.point, dtype=torch.float64)
    in_scene = opened.scene.world_from_scene.inverse().apply(point)
    with torch.no_grad():
        splats = opened.model.splats()
        distances = (splats.means.double().cpu() - in_scene).norm(dim=1)
        nearest = distances.topk(min(NEIGHBORS, len(distances)), largest=False).indices
        return splats.extra[nearest.to(splats.extra.device)].mean(0)


def _write_views(opened, vector, folder):
    """Write the heat map of each held-out view; the largest relevance in each, by name.

    The photo is beside it where there is one: a model file has none.
    """
    import torch
    from PIL import Image

    from gsfw.api import Split
    from gsfw_feature_3dgs.images import heat

    found, views = {}, opened.data.views(Split.EVAL)
    folder.mkdir(parents=True, exist_ok=True)
    for index, (name, camera) in enumerate(zip(views.names, views.cameras, strict=True)):
        relevance = opened.method.relevance(opened.render(camera.to(opened.device)), vector)
        panels = [heat(relevance)]
        if opened.data.has_images:
            (batch,) = opened.data.load(Split.EVAL, [index], opened.device)
            panels.insert(0, batch.target(opened.render_settings.background)[0])
        pixels = torch.cat(panels, dim=1).clamp(0, 1).mul(255).byte().cpu().numpy()
        Image.fromarray(pixels).save(folder / f"{Path(name).stem}.png")
        found[name] = float(relevance.max())
    return found


def _best_place(opened, vector):
    """Similarity and centre, in the world of the data, of the Gaussians that resemble it most."""
    import torch
    from torch.nn.functional import cosine_similarity

    with torch.no_grad():
        splats = opened.model.splats()
        similar = cosine_similarity(splats.extra, vector.to(splats.extra), dim=-1)
        best = (similar * splats.opacities).topk(max(1, int(BEST * len(similar)))).indices
        place = opened.scene.world_from_scene.apply(splats.means[best].median(0).values.cpu())
    return float(similar[best].mean()), [float(x) for x in place]
