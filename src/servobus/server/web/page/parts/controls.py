"""What servos are driven with on pages: a dial on which a goal is set, and a button that drives while it is held."""

from collections.abc import Callable
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class Aim(Element, component="aim.js"):
    """A dial with the range of a servo, the limits set in it, where it is, and a goal. Angles in rad.

    aimed  called with each goal that is set, and whether it is the one that was meant: the hand let go
    """

    def __init__(self, label: str, aimed: Callable[[float, bool], Any]) -> None:
        super().__init__()
        self._props.update(low=0.0, high=1.0, least=0.0, most=1.0, disabled=True, label=label)

        async def aim(event: GenericEventArguments) -> None:
            goal = event.args["goal"]
            if isinstance(goal, int | float):
                await aimed(float(goal), bool(event.args["done"]))

        self.on("aim", aim)

    def bounds(self, limits: tuple[float, float], range: tuple[float, float], *, disabled: bool) -> None:
        """Draw this range, and these limits in it."""
        self._props.update(low=limits[0], high=limits[1], least=range[0], most=range[1], disabled=disabled)
        self.update()

    def see(self, position: float | None) -> None:
        """Show where the servo is."""
        self.run_method("see", position)

    def set_goal(self, goal: float | None) -> None:
        """Show another goal, or none, unless a hand is on the dial."""
        self.run_method("set_goal", goal)


class Hold(Element, component="hold.js"):
    """A button that drives while it is held.

    held      called again and again with the number of the message, and the time of the page in s
    released  called when it is known that the button was let go; that may never be told
    """

    def __init__(self, label: str, held: Callable[[int, float], Any], released: Callable[[], Any]) -> None:
        super().__init__()
        self._props.update(label=label, disabled=False)

        async def hold(event: GenericEventArguments) -> None:
            number, sent = event.args["number"], event.args["sent"]
            if isinstance(number, int) and isinstance(sent, int | float):
                await held(number, float(sent))

        async def release() -> None:
            await released()

        self.on("held", hold)
        self.on("released", release)
