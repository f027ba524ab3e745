"""Who may move which servo: against a plain model of the table at the head of the module, and by example."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.errors import Held, Stopped
from servobus.server.ports.leases import Leases, StopLatch


@dataclass(eq=False)
class Person:
    name: str


ANNA, BERT = Person("Anna"), Person("Bert")
PEOPLE = [ANNA, BERT, Person("Carl")]
SERVOS = ["a", "b", "c"]


def leases() -> tuple[Leases[str], dict[str, str]]:
    """Give leases, and a table of holders kept from what they tell."""
    told: dict[str, str] = {}

    def changed(servo: str, holder: object) -> None:
        if holder is None:
            del told[servo]
        else:
            told[servo] = holder.name  # type: ignore[attr-defined] # all holders here are a Person

    return Leases(changed), told


steps = st.lists(
    st.tuples(st.sampled_from(["take", "take_over", "end"]), st.sampled_from(PEOPLE), st.sets(st.sampled_from(SERVOS)))
)


@given(steps)
def test_one_holder_at_most_and_every_change_is_told(steps: list[tuple[str, Person, set[str]]]) -> None:
    held, told = leases()
    model: dict[str, Person] = {}
    for step, who, servos in steps:
        others = {servo for servo in servos if model.get(servo, who) is not who}
        if step == "take" and others:
            with pytest.raises(Held):
                held.take(who, sorted(servos))
        elif step == "take":
            held.take(who, sorted(servos))
            model.update(dict.fromkeys(servos, who))
        elif step == "take_over":
            assert held.take_over(who, sorted(servos)) == {servo: model[servo] for servo in others}
            model.update(dict.fromkeys(servos, who))
        else:
            ended = {servo for servo in servos if model.get(servo) is who}
            assert set(held.end(who, servos)) == ended
            for servo in ended:
                del model[servo]
        assert {servo: held.holder(servo) for servo in SERVOS} == {servo: model.get(servo) for servo in SERVOS}
        assert told == {servo: holder.name for servo, holder in model.items()}
        for person in PEOPLE:
            assert set(held.held_by(person)) == {servo for servo in model if model[servo] is person}


def test_the_refusal_names_servo_holder_and_remedy() -> None:
    held, _ = leases()
    held.take(ANNA, ["a"])
    with pytest.raises(Held, match=r"a is held by Anna: Bert may read it; take the lease over") as caught:
        held.check(BERT, ["b", "a"])
    assert caught.value.by == "Anna"
    held.check(ANNA, ["a", "b"])


def test_a_lease_goes_with_the_new_id() -> None:
    held, told = leases()
    held.take(ANNA, ["a"])
    held.rename("a", "z")
    assert held.holder("z") is ANNA
    assert held.holder("a") is None
    assert told == {"z": "Anna"}
    held.rename("b", "y")
    assert told == {"z": "Anna"}


def test_all_leases_of_one_end_at_once() -> None:
    held, told = leases()
    held.take(ANNA, ["a", "b"])
    held.take(BERT, ["c"])
    assert held.end(ANNA) == ["a", "b"]
    assert told == {"c": "Bert"}


def test_a_stop_of_the_port_forbids_servos_that_nobody_has_met() -> None:
    latch: StopLatch[str] = StopLatch()
    latch.check(["a"])
    latch.stop("Anna", 5.0)
    with pytest.raises(Stopped, match="never-met was stopped by Anna and must not move until somebody resumes it"):
        latch.check(["never-met"])
    latch.resume(["never-met"])  # one servo cannot be let out of a stop of all
    with pytest.raises(Stopped):
        latch.check(["never-met"])
    latch.resume()
    latch.check(["never-met"])


def test_servos_stopped_one_by_one_are_resumed_one_by_one() -> None:
    latch: StopLatch[str] = StopLatch()
    latch.stop("Anna", 5.0, ["a", "b"])
    latch.check(["c"])
    latch.resume(["a"])
    latch.check(["a"])
    with pytest.raises(Stopped):
        latch.check(["a", "b"])
    assert latch.servos == ["b"]
    assert latch.stopped("b") is not None
    assert latch.stopped("a") is None
