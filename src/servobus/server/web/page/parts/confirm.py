"""A question before what cannot be undone, or what moves something."""

from collections.abc import Sequence

from nicegui import ui


async def confirm(title: str, text: str, *, does: str, names: Sequence[str] = (), danger: bool = False) -> bool:
    """Ask, and give whether the answer is yes.

    does    what the button says, a verb
    names   what is affected, such as the names of servos
    """
    with ui.dialog() as dialog, ui.card().classes("sb-dialog"):
        ui.label(title).classes("sb-title")
        ui.label(text).classes("sb-muted")
        if names:
            with ui.row().classes("sb-chips"):
                for name in names[:MOST_NAMES]:
                    ui.label(name).classes("sb-chip")
                if len(names) > MOST_NAMES:
                    ui.label(f"and {len(names) - MOST_NAMES} more").classes("sb-muted")
        with ui.row().classes("sb-actions"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps color=grey")
            ui.button(does, on_click=lambda: dialog.submit(True)).props(
                f"unelevated no-caps autofocus color={'negative' if danger else 'primary'}"
            )
    try:
        return bool(await dialog)
    finally:
        dialog.delete()


MOST_NAMES = 12
"""Names that are spelled out in a question."""
