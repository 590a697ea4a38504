"""The front holds what nothing beats, and a difference within the spread beats nothing."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gsfw.studies.tradeoff.front import Point, beats, front, same_time, size_front, time_front
from gsfw.studies.tradeoff.record import Record


def record(name, psnr, size=100, readings=(), axis="sh"):
    return Record(
        axis=axis,
        name=name,
        per_view=[{"psnr": psnr}],
        relative_l2=0.0,
        max_error=0.0,
        num_gaussians=1,
        floats=size // 4,
        parameter_bytes=size,
        readings=list(readings),
    )


values = st.integers(-8, 8).map(lambda number: number / 2)
points = st.lists(st.builds(Point, st.just("p"), values, values), min_size=1, max_size=9)


@settings(max_examples=80)
@given(points)
def test_without_tolerance_the_front_is_that_of_pareto(found):
    plain = [
        p
        for p in found
        if not any(
            q.cost <= p.cost
            and q.quality >= p.quality
            and (q.cost, q.quality) != (p.cost, p.quality)
            for q in found
        )
    ]
    assert sorted(front(found), key=repr) == sorted(plain, key=repr)


@settings(max_examples=120)
@given(points, st.sampled_from([0.0, 0.5, 1.0, 2.5]), st.sampled_from([0.0, 0.5, 1.0, 2.5]))
def test_a_front_is_never_empty_and_nothing_on_it_is_beaten(found, same_cost, same_quality):
    unbeaten = front(found, same_cost, same_quality)
    assert unbeaten
    for point in unbeaten:
        assert not any(beats(other, point, same_cost, same_quality) for other in found)
    for point in found:
        if point not in unbeaten:
            assert any(beats(other, point, same_cost, same_quality) for other in found)


@settings(max_examples=80)
@given(points, st.sampled_from([0.5, 1.0, 2.5]))
def test_following_who_beats_whom_never_comes_back(found, same):
    left = list(found)
    while left:
        unbeaten = front(left, same, same)
        assert unbeaten
        left = [point for point in left if point not in unbeaten]


def test_a_gain_within_the_tolerance_is_a_tie_and_a_loss_beyond_it_decides():
    exact, faster = Point("exact", 10.0, 30.0), Point("a little faster", 9.8, 29.0)
    assert beats(exact, faster, same_cost=0.5)
    assert not beats(exact, faster, same_cost=0.1)
    twin = Point("twin", 9.8, 30.005)
    assert not beats(exact, twin, 0.5, 0.01)
    assert not beats(twin, exact, 0.5, 0.01)
    assert len(front([exact, twin], 0.5, 0.01)) == 2


def test_sizes_are_exact_and_only_storage_has_them():
    found = size_front(
        [
            record("as it is", 30.0, 1000, axis="as it is"),
            record("equal", 30.005, 999),
            record("half", 29.0, 500),
            record("worse", 28.9, 500),
            record("quick", 31.0, 1, axis="cutoffs"),
        ]
    )
    assert [point.name for point in found] == ["sh: half", "sh: equal"]


def test_times_that_were_taken_once_are_all_ties():
    slow, quick = record("slow", 30.0, readings=[9.0]), record("quick", 29.0, readings=[1.0])
    assert [point.name for point in time_front([slow, quick])] == ["sh: slow"]


def test_times_within_twice_the_usual_spread_are_ties():
    steady = record("steady", 30.0, readings=[10.0, 10.0, 10.2, 10.4, 10.4])
    assert same_time([steady]) > 0.07
    quicker = record("quicker", 29.0, readings=[9.6, 9.7, 9.8, 9.9, 10.0])
    fast = record("fast", 28.0, readings=[5.0, 5.0, 5.1, 5.2, 5.2])
    unknown = record("never timed", 40.0)
    names = [point.name for point in time_front([steady, quicker, fast, unknown])]
    assert names == ["sh: fast", "sh: steady"]
