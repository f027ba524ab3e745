"""What a page shows where there is nothing to show: why, and what to do."""

from nicegui import ui


def empty(icon: str, title: str, text: str) -> ui.column:
    """Say why there is nothing; what is built inside stands below the text, such as a button."""
    with ui.column().classes("sb-empty items-center") as column:
        ui.icon(icon).classes("sb-empty-icon")
        ui.label(title).classes("sb-empty-title")
        ui.label(text).classes("sb-muted")
    return column
