"""The picture of a step response. Needs matplotlib, an extra: `pip install "servobus[plot]"`."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servobus.cli.response import Response, Sample
from servobus.core.units import deg
from servobus.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = (".png", ".svg", ".pdf")


def check(path: Path) -> None:
    """Refuse a file that cannot be drawn, before the work is done. Raises UsageError."""
    if path.suffix.lower() not in KINDS:
        raise UsageError(f"{path}: a picture is one of {', '.join(kind[1:] for kind in KINDS)}")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.absolute().parent}")
    try:
        import matplotlib  # noqa: F401, ICN001, PLC0415 - an extra, and slow to import
    except ImportError:
        raise UsageError('--plot needs matplotlib: pip install "servobus[plot]"') from None


def draw(response: Response, title: str, path: Path) -> None:
    """Draw position, speed, duty, current and temperature over time, as far as they are known."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - see above

    rows: list[tuple[str, Callable[[Sample], float]]] = [
        ("speed\n°/s", lambda sample: sample.speed / deg),
        ("duty\n%", lambda sample: 100 * sample.duty),
        ("current\nA", lambda sample: sample.current),
        ("case\n°C", lambda sample: sample.temperature),
    ]
    known = [(label, value) for label, value in rows if any(not math.isnan(value(s)) for s in response.samples)]
    figure = Figure(figsize=(8, 3 + 1.3 * len(known)), layout="constrained")
    axes: Any = figure.subplots(1 + len(known), 1, sharex=True, squeeze=False, height_ratios=[3] + [1] * len(known))
    times = [sample.time for sample in response.samples]
    _draw_position(axes[0][0], response, times)
    axes[0][0].set_title(title)
    for (label, value), (axis,) in zip(known, axes[1:], strict=True):
        axis.plot(times, [value(sample) for sample in response.samples], color="tab:blue", linewidth=1)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.ticklabel_format(useOffset=False)
        low, high = axis.get_ylim()
        if high - low < 1:  # a hundredth of a degree is not to fill the picture
            axis.set_ylim((low + high) / 2 - 0.5, (low + high) / 2 + 0.5)
    axes[-1][0].set_xlabel("s")
    figure.savefig(path)


def _draw_position(axis: "Axes", response: Response, times: list[float]) -> None:
    axis.axhline(response.goal / deg, color="tab:gray", linestyle="--", linewidth=1, label="goal")
    if any(not math.isnan(sample.trajectory) for sample in response.samples):
        trajectory = [sample.trajectory / deg for sample in response.samples]
        axis.plot(times, trajectory, color="tab:orange", linewidth=1, label="trajectory")
    position = [sample.position / deg for sample in response.samples]
    axis.plot(times, position, color="tab:blue", linewidth=1.5, label="present")
    axis.set_ylabel("position\n°")
    axis.grid(alpha=0.3)
    axis.legend(loc="lower right")
