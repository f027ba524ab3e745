"""Which pages there are, in the order in which people look for them."""

from collections.abc import Callable
from dataclasses import dataclass

from servobus.server.web.page import bench, doctor, move, overview, packets, plot, servo
from servobus.server.web.page.context import PageContext


@dataclass(frozen=True, slots=True)
class Entry:
    """A page.

    name    by which other pages lead to it, see `PageContext.go`
    icon    its name among the Material icons
    about   one sentence for people who see it for the first time
    """

    name: str
    title: str
    icon: str
    about: str
    build: Callable[[PageContext], object]

    @property
    def path(self) -> str:
        return "/" if self is PAGES[0] else f"/{self.name}"


PAGES = (
    Entry("overview", "Overview", "grid_view", "All servos, as they are now", overview.build),
    Entry("servo", "Servo", "tune", "Settings of one servo", servo.build),
    Entry("move", "Move", "open_with", "Turn servos by hand, poses and motions", move.build),
    Entry("plot", "Plot", "show_chart", "Values against time", plot.build),
    Entry("packets", "Packets", "swap_vert", "What goes over the line", packets.build),
    Entry("doctor", "Doctor", "medical_services", "What is wrong, and how to mend it", doctor.build),
    Entry("bench", "Bench", "science", "Loads and faults of virtual servos", bench.build),
)
