"""When bulk data to a node are given up."""

from zacoustic.core.transport.objects.sending.bulkpaths import BulkPaths

MINUTE_NS = 60_000_000_000


def attempts(paths: BulkPaths, *, heard: bool, begun_at: int = 0) -> int:
    """Return how many attempts in a row are in vain before the service is given up."""
    for count in range(1, 100):
        now = begun_at + count * MINUTE_NS
        if paths.fails(2, now if heard else -1, now):
            return count
    raise AssertionError("never")


def test_less_patience_with_a_node_that_is_heard_and_that_nothing_has_reached() -> None:
    assert attempts(BulkPaths(), heard=True) == 3
    assert attempts(BulkPaths(), heard=False) == 12


def test_more_patience_where_bulk_data_have_got_through_but_only_once() -> None:
    paths = BulkPaths()
    assert not paths.works(2), "no news"
    assert attempts(paths, heard=True) == 8
    assert paths.is_off(2, 9 * MINUTE_NS)
    assert attempts(paths, heard=True, begun_at=30 * MINUTE_NS) == 3
    assert paths.works(2), "news"
    assert not paths.is_off(2, 34 * MINUTE_NS)
