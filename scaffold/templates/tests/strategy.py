"""Tests of strategy my-part."""

from gsfw.testing import conformance

from my_part import strategy

test_conforms = conformance("strategy", "my-part")


def test_rounds_come_at_intervals_until_the_end():
    config = strategy.MyPartConfig(every=10, stop=35)
    refiner = strategy.MyPart(config)
    assert [step + 1 for step in range(50) if refiner.growth_due(step)] == [10, 20, 30]
