"""Counters of a bus: what is counted where, and how it is shown."""

import pytest

from servobus.errors import UnknownName
from servobus.link.stats import COLUMNS, Counts, Stats


def test_an_id_never_asked_begins_at_zero_and_is_kept() -> None:
    stats = Stats()
    assert all(getattr(stats[7], name) == 0 for name in COLUMNS)
    assert stats[7] is stats[7]


def test_the_total_adds_up_but_for_the_worst() -> None:
    stats = Stats()
    for id, sent, worst in ((1, 3, 0.002), (2, 4, 0.005), (254, 1, 0.0)):
        stats[id].sent, stats[id].worst = sent, worst
    stats[2].junk = 9
    assert (stats.total.sent, stats.total.junk, stats.total.worst) == (8, 9, 0.005)


def test_asking_for_the_total_counts_nothing() -> None:
    stats = Stats()
    stats[1].sent = 1
    assert [stats.total.sent for _ in range(3)] == [1, 1, 1]


def test_failed_is_what_got_no_answer_at_once() -> None:
    counts = Counts()
    counts.timeouts, counts.checksum, counts.echo, counts.strangers, counts.late = 1, 2, 4, 8, 16
    assert counts.failed == 7


def test_the_table_has_a_line_for_each_that_was_asked_and_the_sum() -> None:
    stats = Stats()
    stats[12].sent, stats[12].received, stats[12].worst = 1_000_000, 999_999, 0.01234
    stats[3].sent = 5
    stats[9].strangers = 2  # was never asked: in the sum alone
    head, *lines = str(stats).splitlines()
    assert head.split() == ["id", *COLUMNS]
    assert [line.split()[0] for line in lines] == ["3", "12", "total"]
    assert lines[1].split()[1:3] == ["1000000", "999999"]
    assert lines[1].endswith("12.3ms")
    assert lines[2].split()[1] == "1000005"
    assert lines[2].split()[5] == "2"


def test_counts_show_themselves_without_the_zeros() -> None:
    stats = Stats()
    assert repr(stats[1]) == str(stats[1]) == "<sent 0, received 0>"
    stats[1].sent, stats[1].received, stats[1].timeouts, stats[1].worst = 5, 4, 1, 0.0023
    stats[2].sent = 3
    assert repr(stats[1]) == "<sent 5, received 4, timeouts 1, worst 2.3ms>"
    assert repr(stats) == "<Stats of 2 ids: sent 8, received 4, timeouts 1, worst 2.3ms>"


class TestServos:
    """A servo is a family, an id and a speed; an id alone stands for one where it is unique."""

    def two(self) -> Stats:
        stats = Stats()
        for family, baud, received in (("dynamixel", 57_600, 4), ("herkulex", 115_200, 2)):
            counts = stats.servo(family, 1, baud)
            counts.sent, counts.received = 5, received
        return stats

    def test_two_families_with_one_id_are_not_mixed(self) -> None:
        stats = self.two()
        assert stats["dynamixel", 1, 57_600].received == 4
        assert stats["herkulex", 1, 115_200].received == 2
        assert stats.total.received == 6

    def test_an_id_of_several_names_them(self) -> None:
        with pytest.raises(UnknownName, match="id 1 is not unique here: dynamixel at 57600 and herkulex at 115200"):
            self.two()[1]

    def test_an_id_that_only_one_answered_to_is_that_servo(self) -> None:
        stats = self.two()
        stats.servo("lewansoul", 2, 115_200).sent = 1  # a scan asks every family for every id
        stats.servo("dynamixel", 2, 57_600).sent = 1
        stats.servo("dynamixel", 2, 57_600).received = 1
        assert stats[2] is stats["dynamixel", 2, 57_600]

    def test_an_id_that_nobody_answered_to_is_what_was_asked_in_vain(self) -> None:
        stats = Stats()
        for family in ("dynamixel", "herkulex", "lewansoul"):
            counts = stats.servo(family, 77, 115_200)
            counts.sent = counts.timeouts = 2
        assert (stats[77].sent, stats[77].timeouts) == (6, 6)

    def test_counters_that_were_taken_before_the_first_question_go_on(self) -> None:
        stats = Stats()
        early = stats[7]
        stats.servo("lewansoul", 7, 115_200).sent += 1
        assert early is stats[7] is stats["lewansoul", 7, 115_200]
        assert early.sent == 1
        assert stats.total.sent == 1

    def test_the_table_names_the_family_where_an_id_is_not_unique(self) -> None:
        stats = self.two()
        stats.servo("lewansoul", 2, 115_200).sent = 1
        _, *lines = str(stats).splitlines()
        assert [line.rsplit(maxsplit=len(COLUMNS))[0].strip() for line in lines] == [
            "dynamixel 1 at 57600",
            "herkulex 1 at 115200",
            "2",
            "total",
        ]
        assert len(set(map(len, str(stats).splitlines()))) == 1
