"""What a budget may say, and how many rows that is."""

import pytest
from support.gaussians import gaussians, toy_scene

from gsfw.core.capabilities import Feature
from gsfw.core.errors import ConfigError
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.mcmc import McmcConfig

STRATEGIES = pytest.mark.parametrize("kind", [AdcConfig, McmcConfig])


def test_a_number_is_that_many_rows_and_auto_and_none_leave_it_open():
    model = gaussians(20)
    found = {text: AdcConfig(budget=text).parsed_budget() for text in ("none", "auto", "50000")}
    assert [found[text].most_rows(model) for text in found] == [None, None, 50_000]
    assert [found[text].is_given for text in found] == [False, True, True]


def test_megabytes_are_rows_of_the_mean_size_that_they_have():
    model = gaussians(20, degree=1)  # 3 + 4 + 3 + 1 + 12 numbers of 4 bytes.
    budget = AdcConfig(budget="0.00092MB").parsed_budget()
    assert budget.most_rows(model) == 10
    assert AdcConfig(budget="20MB").parsed_budget().most_rows(model) == 20_000_000 // 92
    assert AdcConfig(budget="0.00001MB").parsed_budget().most_rows(model) == 1


@STRATEGIES
@pytest.mark.parametrize("text", ["lots", "0", "-5", "3GBB", "0MB", "1e5", "MB", ""])
def test_what_is_no_budget_is_refused(kind, text):
    with pytest.raises(ConfigError) as caught:
        kind(budget=text).build(toy_scene())
    assert caught.value.message == (
        f"strategy.budget={text}: expected none, auto, a number of Gaussians such as 50000, "
        "or megabytes such as 20MB."
    )


@STRATEGIES
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"budget_every": 0}, "strategy.budget_every=0: expected at least 1."),
        ({"budget_share": 0.0}, "strategy.budget_share=0: expected a number between 0 and 1."),
        ({"budget_share": 1.0}, "strategy.budget_share=1: expected a number between 0 and 1."),
    ],
)
def test_settings_out_of_range_are_refused(kind, settings, said):
    with pytest.raises(ConfigError) as caught:
        kind(**settings).build(toy_scene())
    assert caught.value.message == said


@STRATEGIES
def test_contributions_are_needed_only_under_a_budget(kind):
    assert Feature.CONTRIBUTION not in kind().needs().features
    assert kind(budget="auto").needs().features == kind().needs().features | {Feature.CONTRIBUTION}
