"""A search asks for runs in rounds, and for nothing that cannot be known to be worth it."""

from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.training.axes import Choice, Recipe
from gsfw.studies.tradeoff.training.search import Outcome, Search

SINGLES = [
    Recipe((Choice("sh_degree", "sh 1", {"sh_degree": 1}),)),
    Recipe((Choice("sh_degree", "sh 0", {"sh_degree": 0}),)),
    Recipe((Choice("cap", "cap 1/2", part=0.5),)),
    Recipe((Choice("resolution", "small", {"downscale": 2}),)),
]
LOST = {"sh 1": 0.1, "sh 0": 1.0, "cap 1/2": 0.2, "small": 3.0}
SIZE = {"sh 1": 0.4, "sh 0": 0.2, "cap 1/2": 0.3, "small": 1.0}


def outcome(trial):
    """Losses add up, sizes multiply, and longer is better."""
    psnr, size = 20.0 + trial.steps / 100, 1e6
    for choice in trial.recipe.choices:
        psnr, size = psnr - LOST[choice.name], size * SIZE[choice.name]
    return Outcome(psnr + (trial.seed - 1) / 10, size)


NOTHING = Wish()


def run(goal=NOTHING, made=lambda trial: True, lengths=(100, 200, 400)):
    """All rounds, where some trials are made at once."""
    done = set()

    def found(trial):
        return outcome(trial) if (trial.name, trial.seed) in done else None

    search, rounds = Search(SINGLES, lengths, 1, goal, found), []
    for item in search.rounds():
        rounds.append([trial.name for trial in item.trials])
        done |= {(trial.name, trial.seed) for trial in item.trials if made(trial)}
    return rounds


def test_rounds_come_in_order_and_halve():
    first, bound, together, second, third, again = run(Wish(psnr=23.5))
    assert first == [
        *("baseline, 400 steps", "baseline, 200 steps", "baseline, 100 steps"),
        *("sh 1, 100 steps", "sh 0, 100 steps", "small, 100 steps"),
    ]
    assert bound == ["cap 1/2, 100 steps"]
    assert together == ["sh 1 + cap 1/2, 100 steps", "sh 0 + cap 1/2, 100 steps"]
    # Of six, the three smallest that should have 23.5 dB after 400 steps, and then one of these.
    assert second == [
        *("sh 1 + cap 1/2, 200 steps", "cap 1/2, 200 steps", "sh 1, 200 steps"),
    ]
    assert third == ["sh 1 + cap 1/2, 400 steps"]
    assert again[0] == "sh 0 + cap 1/2, 100 steps"


def test_what_is_limited_by_the_baseline_waits_for_it():
    first, bound, *_ = run(made=lambda trial: trial.recipe.choices or trial.steps != 100)
    assert "cap 1/2, 100 steps" not in first
    assert bound == ["cap 1/2, 100 steps"]


def test_what_was_not_made_goes_no_further():
    rounds = run(made=lambda trial: trial.recipe.name != "sh 1")
    assert not any("sh 1, 200 steps" in item for item in rounds)
    assert run(made=lambda trial: False)[2:] == []


def test_with_one_length_nothing_is_halved():
    rounds = run(lengths=(100,))
    assert len(rounds) == 4
    assert rounds[0][0] == "baseline, 100 steps"
    assert all(name.endswith(" 100 steps") for item in rounds for name in item)


def test_lengths_that_are_the_same_are_tried_once():
    assert run(lengths=(1, 1, 1))[0].count("baseline, 1 steps") == 1
