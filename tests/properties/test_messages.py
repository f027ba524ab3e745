"""Messages between the process that owns the ports and its clients: what goes comes back, and nothing else is taken."""

import json
from collections.abc import Callable
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus import errors
from servobus.core.exchange import Batch, Exchange, GroupExchange, LateAnswers, Pause, ReplyPattern, Settle
from servobus.errors import BusError, ServobusError
from servobus.families.registry import FAMILIES, MODELS
from servobus.remote.faults import error_of, fault
from servobus.remote.messages import KINDS, Malformed, decode, encode
from servobus.remote.protocol import RequestReader, SentRequest
from servobus.remote.steps import SentExchange, exchange_of, sent, step_of

SIMPLE: dict[Any, st.SearchStrategy[Any]] = {
    str: st.text(max_size=8),
    bool: st.booleans(),
    int: st.integers(-(2**40), 2**40),
    float: st.floats(allow_nan=False, allow_infinity=False),
    bytes: st.binary(max_size=8),
    NoneType: st.none(),
}
ATOMS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5)
JSON = st.recursive(
    ATOMS,
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=2), inner, max_size=2),
    max_leaves=4,
)


def values(hint: Any, depth: int = 3) -> st.SearchStrategy[Any]:
    """Give values of a type, by its annotation."""
    if hint in SIMPLE:
        return SIMPLE[hint]
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return st.one_of(*(values(one, depth) for one in inner))
    if origin is tuple and inner[1:] == (...,):
        return st.lists(values(inner[0], depth - 1), max_size=2).map(tuple) if depth > 0 else st.just(())
    if origin is tuple:
        return st.tuples(*(values(one, depth) for one in inner))
    hints = get_type_hints(hint)
    return st.builds(hint, *(values(hints[name], depth - 1) for name in hint.__match_args__))


@pytest.mark.parametrize("kind", list(KINDS))
def test_what_goes_comes_back(kind: str) -> None:
    @given(values(KINDS[kind]))
    def check(message: Any) -> None:
        line = encode(message)
        assert line.endswith(b"\n")
        assert line.count(b"\n") == 1
        assert decode(line) == message

    check()


@given(st.binary() | JSON.map(json.dumps))
def test_a_line_of_anything_is_refused(line: bytes | str) -> None:
    with pytest.raises(Malformed):
        decode(line)


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_field_more_or_less_or_of_another_type_is_refused(kind: str) -> None:
    @given(values(KINDS[kind]), st.data())
    def check(message: Any, data: st.DataObject) -> None:
        right = json.loads(encode(message))
        name = data.draw(st.sampled_from([*right, "other"]))
        wrong: dict[str, Any] = right | {name: data.draw(JSON)}
        line = json.dumps(wrong)
        try:
            found = decode(line)
        except Malformed:
            return
        # What is taken is what was said: nothing is bent to fit.
        assert type(found) is type(message)
        assert json.loads(encode(found)) == {name: item for name, item in wrong.items() if name in found_fields(found)}

    def found_fields(found: Any) -> set[str]:
        return set(json.loads(encode(found)))

    check()


@pytest.mark.parametrize(
    "line",
    [
        "", "[]", "null", "7", '"beat"', "{", "{}", '{"k":7}', '{"k":"nothing"}', '{"k":"beat"}',
        '{"k":"beat","time":"1"}', '{"k":"beat","time":true}', '{"k":"beat","time":NaN}', '{"k":"beat","time":1e999}',
        '{"k":"beat","time":1,"more":1}', '{"k":["beat"]}', "[" * 100_000, '{"k":"beat","time":' + "9" * 5000 + "}",
        '{"k":"release","bus":"\\ud800"}', '{"k":"packet","data":"0"}',
    ],
)  # fmt: skip
def test_these_lines_are_refused(line: str) -> None:
    with pytest.raises(Malformed):
        decode(line)


def test_a_whole_number_will_do_for_a_time_and_is_one_then() -> None:
    assert isinstance(decode('{"k":"beat","time":1}').time, float)


# Errors

ERRORS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, ServobusError)]
MAKE: dict[str, Callable[[], ServobusError]] = {
    "NotRestored": lambda: errors.NotRestored("not all", ["led"], {"id": "refused"}),
    "Refused": lambda: errors.Refused("no", 4),
    "Held": lambda: errors.Held("by Ann", "Ann"),
    "RobotMismatch": lambda: errors.RobotMismatch("other servos", ["elbow is missing"]),
    "StopFailed": lambda: errors.StopFailed(
        "one may move", {"id 1": errors.NoReply("silent", b"\x01")}, {"id 2": "held"}
    ),
}


@pytest.mark.parametrize("kind", ERRORS, ids=lambda kind: kind.__name__)
def test_errors_come_as_what_they_are(kind: type[ServobusError]) -> None:
    if kind.__name__ in MAKE:
        error = MAKE[kind.__name__]()
    else:
        error = kind("what went wrong", b"\xff") if issubclass(kind, BusError) else kind("what went wrong")
    error.add_note("and a note")
    error.before = {"id": "1"}
    back = error_of(decode(encode(fault(error))))
    assert type(back) is kind
    assert str(back) == str(error)
    given, came = ({name: item for name, item in vars(one).items() if name != "failures"} for one in (error, back))
    assert came == given
    if isinstance(back, errors.StopFailed):
        assert isinstance(back.failures["id 1"], errors.NoReply)


def test_an_error_of_another_kind_is_the_nearest_of_ours() -> None:
    class Mine(errors.Garbled):
        pass

    assert type(error_of(fault(Mine("odd")))) is errors.Garbled
    assert type(error_of(fault(ZeroDivisionError("by 0")))) is ServobusError


# Steps


def alike(one: Exchange[Any], other: Exchange[Any]) -> bool:
    """Tell whether two exchanges are the same but for what turns the reply into a result."""
    names = (
        "what", "framing", "request", "id", "replies", "reply_size", "max_delay", "typical_delay", "repeatable",
        "anyway", "joins",
    )  # fmt: skip
    return type(one) is type(other) and all(getattr(one, name) == getattr(other, name) for name in names)


def asked(model: Any) -> list[Exchange[Any]]:
    """Give some exchanges of a model: what asks, what writes, what nobody answers."""
    family = model.family
    ping = family.ping(1)
    return [ping, ping.told(), ping.no_retry(), ping.strict(), ping.behind(b"\x00\x00"), *family.fences(2)]


@pytest.mark.parametrize("key", list(MODELS))
def test_exchanges_come_as_what_they_are(key: str) -> None:
    for exchange in asked(MODELS[key]):
        gone = sent(exchange)
        assert isinstance(gone, SentExchange)
        assert alike(exchange_of(decode(encode(gone))), exchange)


def test_the_other_steps_come_as_what_they_are() -> None:
    rx28, family = MODELS["rx28"], FAMILIES["dynamixel"]
    reads = [MODELS["mx28"].family.fences(id)[0] for id in (1, 2)]
    group = GroupExchange("both", family.framing, reads[0].request, reads)
    for step in (Pause(0.5), Settle(family.framing), LateAnswers(0.1)):
        assert step_of(decode(encode(sent(step)))) == step
    back = step_of(decode(encode(sent(group))))
    assert isinstance(back, GroupExchange)
    assert alike(back, group)
    assert all(map(alike, back.parts, reads))
    batch = step_of(decode(encode(sent(Batch(asked(rx28), again=False, yields=True)))))
    assert isinstance(batch, Batch)
    assert all(map(alike, batch.exchanges, asked(rx28)))
    assert (batch.again, batch.yields) == (False, True)


@pytest.mark.parametrize(
    "changes",
    [
        {"family": "esperanto"}, {"request": b""}, {"request": b"\xff\xff\x01\x02\x01\xfa"},
        {"request": b"\xff\xff\x01\x02\x01\xfb\xff\xff\x01\x02\x01\xfb"}, {"request": bytes(100_000)},
        {"max_delay": -1.0}, {"typical_delay": 1e9}, {"reply": ReplyPattern(1, None, ())},
        {"reply": ReplyPattern(300, None, (0,))}, {"reply": ReplyPattern(1, None, (100_000,))},
        {"reply": ReplyPattern(1, 256, (0,))}, {"reply": ReplyPattern(1, None, (0,), prefix=b"1")},
    ],
)  # fmt: skip
def test_what_is_no_request_is_refused(changes: dict[str, Any]) -> None:
    gone = sent(FAMILIES["dynamixel"].ping(1))
    given = {name: getattr(gone, name) for name in SentExchange.__match_args__} | changes
    with pytest.raises(errors.UsageError):
        exchange_of(SentExchange(**given))


# The reader of requests, which makes a step once


def request(n: int, /, **changes: Any) -> bytes:
    """Give the line of a request, with some fields of JSON changed or more of them."""
    step = SentRequest(n, "arm", 57_600, 2, 0, 1.5, sent(FAMILIES["dynamixel"].ping(1)))
    line = json.loads(encode(step))
    return json.dumps(line | changes | {"step": line["step"]}, separators=(",", ":")).encode()


def test_a_step_that_comes_again_is_the_same_and_all_else_is_read_anew() -> None:
    reader = RequestReader()
    first, again = reader.read(request(1)), reader.read(request(2, baud=1_000_000))
    assert again.step is first.step
    assert (again.n, again.baud) == (2, 1_000_000)
    assert reader.read(request(3)) == decode(request(3))


@pytest.mark.parametrize(
    "changes",
    [{"n": "2"}, {"more": 1}, {"bus": 7}, {"bus": ',"step":'}, {"more": {"a": 1, "step": 2}}, {"time": "NaN"}],
)  # fmt: skip
def test_a_known_step_makes_nothing_else_good(changes: dict[str, Any]) -> None:
    def came(read: Callable[[bytes], Any]) -> Any:
        try:
            return read(request(2, **changes))
        except Malformed:
            return "malformed"

    reader = RequestReader()
    reader.read(request(1))
    assert came(reader.read) == came(decode)


@pytest.mark.parametrize("head", [b'{"k":"step"', b'{"k":"step","n":1', b'{"k":"step",', b'{"k":"step","n":{"a":1'])
def test_the_reader_refuses_a_head_that_is_none(head: bytes) -> None:
    reader = RequestReader()
    reader.read(request(1))
    with pytest.raises(Malformed):
        reader.read(head + b',"step":' + request(1).partition(b',"step":')[2])
