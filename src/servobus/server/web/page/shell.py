"""What stands around every page: navigation, STOP, the bus that is looked at, the state of the connection.

The heartbeat and STOP are a script of their own, `assets/shell.js`: they need nothing of what the page does otherwise.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

from nicegui import PageArguments, ui
from nicegui.events import GenericEventArguments
from starlette.requests import Request

from servobus.server.web.api.answers import role_of
from servobus.server.web.app import WebApplication
from servobus.server.web.page.access import access_menu
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.table import PAGES, Entry

HEAD = """
<link rel="stylesheet" href="/_servobus/theme.css">
<link rel="stylesheet" href="/_servobus/servo.css">
<link rel="stylesheet" href="/_servobus/drive.css">
<script src="/_servobus/shell.js"></script>
"""
Theme = Literal["auto", "light", "dark"]
THEMES: dict[Theme, tuple[bool | None, str]] = {
    "auto": (None, "brightness_auto"),
    "light": (False, "light_mode"),
    "dark": (True, "dark_mode"),
}
"""Name -> value of Quasar, and icon."""
THEME_COOKIE = "servobus_theme"


class Shell:
    """Builds what stands around the pages."""

    def __init__(self, application: WebApplication) -> None:
        self._context = application.context

    def show(self, request: Request) -> None:
        """Build a tab for somebody who has logged in."""
        state = request.state  # the guard lets in nobody without a login
        context = PageContext(self._context, state.login, role_of(state), ui.context.client)
        ui.context.client.on_connect(context.start)
        ui.context.client.on_delete(context.close)
        ui.context.client.on_exception(context.fault)
        ui.add_head_html(HEAD)
        ui.colors(primary="#2f6fed", positive="#12855a", negative="#c9251d", warning="#b7740f", info="#2f6fed")
        Frame(context, request.cookies.get(THEME_COOKIE, ""))


class Frame:
    """The frame of one tab."""

    def __init__(self, context: PageContext, theme: str) -> None:
        self._context = context
        self._theme: Theme = next((name for name in THEMES if name == theme), "auto")
        self._dark = ui.dark_mode(THEMES[self._theme][0])
        self._links: dict[str, ui.link] = {}
        self._drawer = self._navigation()
        self._header()
        with ui.column().classes("sb-page"):
            self._banners = ui.column().classes("sb-banners")
            self._warn()
            self._content = ui.sub_pages({entry.path: self._shows(entry) for entry in PAGES}).classes("sb-content")
        context.content = self._content
        ui.element("button").props('type=button data-stop aria-label="Stop all servos"').classes(
            "sb-stop sb-stop-phone"
        )
        ui.on("servobus_live", self._live)
        context.shell_events(self._event)
        self._stopped()

    # Building

    def _shows(self, entry: Entry) -> Callable[[PageArguments], object]:
        def show(arguments: PageArguments) -> object:
            self._context.turn_to(dict(arguments.query_parameters))
            self._bus_picker()
            self._title.text = entry.title
            for name, link in self._links.items():
                link.classes(
                    add="sb-here" if name == entry.name else "", remove="" if name == entry.name else "sb-here"
                )
            return entry.build(self._context)

        return show

    def _header(self) -> None:
        with ui.header().classes("sb-header"):
            menu = ui.button(icon="menu", color=None, on_click=self._drawer.toggle).props(
                'flat round dense aria-label="Menu"'
            )
            menu.classes("sb-menu")
            self._title = ui.label("").classes("sb-heading").props("role=heading aria-level=1")
            ui.space()
            self._buses = ui.row().classes("no-wrap")
            self._bus_picker()
            ui.element("div").classes("sb-link").props("id=sb-link role=status aria-live=polite")
            self._theme_button = (
                ui.button(color=None, on_click=self._next_theme).props("flat round dense").classes("sb-quiet")
            )
            self._show_theme()
            ui.element("button").props('type=button data-stop aria-label="Stop all servos"').classes("sb-stop")

    def _navigation(self) -> ui.left_drawer:
        with ui.left_drawer(bordered=True).props("width=216 breakpoint=900").classes("sb-nav") as drawer:
            with ui.row().classes("sb-brand items-center no-wrap"):
                ui.element("img").props('src="/_servobus/icon.svg" alt="" width=28 height=28')
                ui.label("servobus")
            with ui.element("nav").props('aria-label="Pages"'):
                for entry in PAGES:
                    with ui.link(target=entry.path).classes("sb-nav-link") as link:
                        ui.icon(entry.icon)
                        ui.label(entry.title)
                    self._links[entry.name] = link
            ui.space()
            context = self._context
            with ui.column().classes("sb-who"), ui.row().classes("sb-row no-wrap"):
                with ui.column().classes("sb-two"):
                    ui.label(context.login.name)
                    ui.label(str(context.role)).classes("sb-muted sb-small")
                access_menu(context)
            ui.label("Space or Esc stops all servos").classes("sb-muted sb-small")
        return drawer

    def _bus_picker(self) -> None:
        """Choose the bus, where there is a choice."""
        self._buses.clear()
        names = list(self._context.service.buses)
        if len(names) < 2:
            return
        bus = self._context.bus
        with self._buses:
            ui.select(names, value=bus and bus.name, on_change=lambda event: self._turn_bus(event.value)).props(
                'dense outlined options-dense aria-label="Bus"'
            ).classes("sb-bus")

    def _turn_bus(self, name: str) -> None:
        path = ui.context.client.sub_pages_router.current_path.partition("?")[0].strip("/")
        self._context.query = {}
        self._context.go(path or "overview", bus=name)

    # The theme

    async def _next_theme(self) -> None:
        names = list(THEMES)
        self._theme = names[(names.index(self._theme) + 1) % len(names)]
        self._dark.set_value(THEMES[self._theme][0])
        self._show_theme()
        await ui.run_javascript(f"servobus.keepTheme('{self._theme}')")  # one of three words

    def _show_theme(self) -> None:
        self._theme_button.props(f'icon={THEMES[self._theme][1]} aria-label="Colours: {self._theme}"')

    # What comes from outside

    def _live(self, event: GenericEventArguments) -> None:
        """Take note of the live connection of this tab; whose it is is looked up where it counts."""
        self._context.connection = str(event.args)[:64]

    def _warn(self) -> None:
        if warning := self._context.application.config.warning:
            with self._banners, ui.row().classes("sb-banner sb-banner-warn"):
                ui.icon("lock_open")
                ui.label(warning)

    def _event(self, event: dict[str, Any]) -> None:
        if event["what"] in ("stopped", "resumed", "opened", "closed", "port gone", "port back", "gone", "back"):
            self._stopped()
        if event["what"] in ("opened", "closed"):
            self._bus_picker()
        if event["what"] == "deadman":
            toast.warned(f"{event.get('why', '')}: its servos were stopped")

    def _stopped(self) -> None:
        """Show which buses were stopped, and which ports are gone."""
        self._banners.clear()
        self._warn()
        with self._banners:
            for bus in self._context.service.buses.values():
                if bus.gone:
                    with ui.row().classes("sb-banner sb-banner-bad").props("role=alert"):
                        ui.icon("usb_off")
                        ui.label(f"{bus.name}: {bus.gone}. It is opened again as soon as it is back.").classes("col")
            stopped = {bus.name: bus.stopped_by for bus in self._context.service.buses.values() if bus.stopped_by}
            if stopped:
                with ui.row().classes("sb-banner sb-banner-bad").props("role=alert"):
                    ui.icon("front_hand")
                    ui.label(stop_said(stopped, list(self._context.service.buses))).classes("col")
                    if self._context.may_change:
                        ui.button("Resume", on_click=lambda: self._resume(list(stopped))).props(
                            "unelevated no-caps color=white text-color=black"
                        )

    async def _resume(self, names: list[str]) -> None:
        context = self._context
        buses = [context.service.buses[name] for name in names if name in context.service.buses]
        sure = await confirm(
            "Resume?",
            "Nothing moves by itself, but programs and pages may move these servos again.",
            does="Resume",
            names=[str(servo["key"]) for bus in buses for servo in bus.servo_entries()],
        )
        if sure:
            for bus in buses:
                await context.attempt(bus.resume(context.actor))


def stop_said(stopped: Mapping[str, str], buses: Sequence[str]) -> str:
    """Say what was stopped and by whom: bus -> name of who did, and all buses that there are."""
    who = " and ".join(dict.fromkeys(stopped.values()))
    what = "Everything" if set(stopped) == set(buses) else " and ".join(stopped)
    return f"{what} was stopped by {who}. Nothing moves until somebody resumes."
