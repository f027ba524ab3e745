"""The pages for people: what the API offers, to look at and to touch.

    table      which pages there are
    shell      what stands around each of them: navigation, STOP, the state of the connection
    context    what a page works on: the bus that is looked at, telemetry, events, who asks
    parts      what several pages show: dials, alarms in words, dialogs
    assets     styles, and the script of the heartbeat, of STOP and of the keys

Each page is a module with one function `build(context)`. Only what changes is sent to the browser.
"""

from servobus.server.web.page.mounting import mount

__all__ = ["mount"]
