"""Which lineages a receiver takes for over."""

from zacoustic.core.transport.reliable.receiving.receivelane import ReceiveLane


def lane(lineage: int) -> ReceiveLane:
    return ReceiveLane(lineage, 0, is_settled=True)


def test_the_few_lineages_before_the_present_one_are_over() -> None:
    present = lane(20)
    assert [each for each in range(41) if present.is_over(each)] == list(range(4, 20))
    assert lane(3).is_over(0xFFFF)
    assert not lane(0xFFFF).is_over(0)


def test_a_lineage_that_was_left_is_over_whatever_its_value() -> None:
    left, _ = ReceiveLane.behind(lane(40_000), 7, 0)
    assert left.is_over(40_000)
    assert not left.is_over(7)
