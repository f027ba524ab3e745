"""Figures of step responses, against curves whose figures are known from the textbook."""

import math

import pytest

from servobus.cli.response import Response, Sample


def response(curve: "list[tuple[float, float]]", goal: float = 1.0, start: float = 0.0, **options: float) -> Response:
    return Response(start, goal, tuple(Sample(time, position) for time, position in curve), **options)


def sampled(function: "object", seconds: float = 5.0, rate: int = 1000) -> list[tuple[float, float]]:
    assert callable(function)
    return [(n / rate, function(n / rate)) for n in range(int(seconds * rate))]


def test_first_order() -> None:
    figures = response(sampled(lambda t: 1 - math.exp(-t / 0.2))).figures()
    assert figures.rise_time == pytest.approx(0.2 * math.log(9), abs=1e-3)
    assert figures.settling_time == pytest.approx(0.2 * math.log(50), abs=2e-3)
    assert figures.overshoot == 0
    assert figures.steady_error == pytest.approx(0, abs=1e-6)


def test_second_order() -> None:
    zeta, omega = 0.4, 10.0
    damped = omega * math.sqrt(1 - zeta**2)

    def curve(t: float) -> float:
        return 1 - math.exp(-zeta * omega * t) * (math.cos(damped * t) + zeta * omega / damped * math.sin(damped * t))

    figures = response(sampled(curve)).figures()
    assert figures.overshoot == pytest.approx(math.exp(-zeta * math.pi / math.sqrt(1 - zeta**2)), abs=1e-4)
    assert figures.settling_time == pytest.approx(0.84, abs=0.05)


@pytest.mark.parametrize("sense", [1, -1])
def test_either_direction(sense: int) -> None:
    figures = response([(0, 2.0), (1, 2 + sense * 1.1), (2, 2 + sense), (9, 2 + sense)], 2 + sense, 2.0).figures()
    assert figures.overshoot == pytest.approx(0.1)
    assert figures.steady_error == pytest.approx(0)


def test_one_that_never_arrives() -> None:
    figures = response([(0, 0.0), (1, 0.5), (2, 0.5)]).figures()
    assert math.isnan(figures.rise_time)
    assert figures.steady_error == pytest.approx(-0.5)
    assert figures.settling_time == 1  # where it is
    assert not figures.arrived


def test_one_that_never_leaves() -> None:
    figures = response([(0, 0.0), (1, 0.01), (2, 0.0)], resolution=0.005).figures()
    assert not figures.arrived
    assert math.isnan(figures.settling_time)
    assert figures.steady_error == pytest.approx(-1)


def test_one_with_no_way_to_go_is_there() -> None:
    figures = response([(0, 1.0), (1, 1.0)], start=1.0).figures()
    assert figures.arrived
    assert figures.settling_time == 0


@pytest.mark.parametrize(("end", "arrived"), [(0.89, False), (0.91, True), (1.09, True), (1.11, False)])
def test_a_tenth_of_the_way_may_be_left(end: float, arrived: bool) -> None:
    assert response([(0, 0.0), (1, end), (2, end)]).figures().arrived is arrived


def test_nothing_finer_than_the_sensor_counts() -> None:
    curve = [(n / 10, 1.0 + (0.01 if n % 2 else 0.0)) for n in range(20)]
    assert response(curve, start=0.9, resolution=0.01).figures().settling_time == 0


def test_the_highest_current_of_either_sign() -> None:
    samples = (Sample(0, 0, current=0.5), Sample(1, 1, current=-2.0), Sample(2, 1, current=math.nan))
    assert Response(0, 1, samples).figures().peak_current == 2.0


def test_no_step_and_no_samples() -> None:
    assert response([(0, 1.0), (1, 1.0)], start=1.0).figures().overshoot == 0
    with pytest.raises(ValueError, match="without samples"):
        response([]).figures()
