"""A key counts as held as long as a terminal repeats it."""

from servobus.cli.held_key import HeldKey


def test_a_key_counts_as_held_while_a_terminal_repeats_it() -> None:
    key = HeldKey()
    assert not key.held(0.0)
    key.pressed(0.0)
    assert key.held(0.6)  # the pause before it is repeated
    assert not key.held(0.8)
    key.pressed(1.0)
    for n in range(10):
        key.pressed(1.5 + 0.03 * n)
    assert key.held(1.9)
    assert not key.held(2.0)
