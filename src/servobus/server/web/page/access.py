"""Who is logged in: links for other browsers, and logging out.

Both are asked of the API by the browser, past the socket of the page: so the guard judges them by its rules.
"""

from nicegui import ui

from servobus.server.web.auth import LINK_TIME, Role
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast

MEANS = {
    Role.VIEWER: "looks at everything, and stops",
    Role.OPERATOR: "moves servos and changes settings",
    Role.ADMIN: "gives others access, too",
}


def access_menu(context: PageContext) -> None:
    """Build the menu of who is logged in."""
    button = ui.button(icon="more_vert", color=None).props('flat round dense aria-label="Access"').classes("sb-quiet")
    with button, ui.menu():
        if context.role >= Role.ADMIN:
            ui.menu_item("Link for another browser", _make_link)
        if context.login.kind == "browser":
            ui.menu_item("Log out", _log_out)


async def _make_link() -> None:
    with ui.dialog() as dialog, ui.card().classes("sb-dialog"):
        ui.label("Link for another browser").classes("sb-title")
        ui.label(f"It logs one browser in, once, within {LINK_TIME / 60:.0f} min.").classes("sb-muted")
        role = ui.radio({one: f"{one}: {MEANS[one]}" for one in Role}, value=Role.OPERATOR)
        link = ui.input("Link").props("outlined dense readonly").classes("full-width sb-mono")
        link.visible = False

        async def make() -> None:
            chosen = Role(role.value)  # one of three words
            answer = await ui.run_javascript(f"return await servobus.ask('POST', '/links', {{role: '{chosen}'}})")
            if "error" in answer:
                toast.warned(str(answer["error"]["message"]))
            else:
                link.value, link.visible = str(answer["url"]), True

        async def copy() -> None:
            ui.clipboard.write(link.value)
            toast.told("Copied")

        with link.add_slot("append"):
            ui.button(icon="content_copy", color=None, on_click=copy).props('flat dense round aria-label="Copy"')
        with ui.row().classes("sb-actions"):
            ui.button("Close", color=None, on_click=lambda: dialog.submit(None)).props("flat no-caps")
            ui.button("Make a link", on_click=make).props("unelevated no-caps")
    try:
        await dialog
    finally:
        dialog.delete()


def _log_out() -> None:
    ui.run_javascript("servobus.ask('DELETE', '/session').then(() => location.assign('/'))")
